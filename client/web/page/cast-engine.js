/** The worker of a caster: its frames go to the page, as colours and distances. */

import { Engine, serve } from './engine-core.js';

/** A frame that waits for tiles, or for the time that other work needs, waits less. */
const REST_MS = 10_000;

/** Posts frames. */
class FramePost {
  #canvas = new OffscreenCanvas(1, 1);
  /** The camera of the next frame, and what the frame that is being drawn has. */
  camera;
  #step;
  #frameCamera;
  #distances = new Float32Array();
  #isResting = false;

  /** @param {any} options */
  constructor(options) {
    this.camera = options.camera;
    options.canvasGpu = this.#canvas;
  }

  begin(step) {
    this.#isResting = false;
    this.#step = step;
    if (!step.isNew) return;
    this.#frameCamera = this.camera;
    this.#distances = new Float32Array(step.width * step.height);
  }

  rows({ width, first, end }, hit) {
    const parts = new Float32Array(hit.buffer);
    for (let row = first; row < end; row++) {
      const at = (2 * (row - first) + 1) * width;
      this.#distances.set(parts.subarray(at, at + width), row * width);
    }
  }

  show({ data: colours }) {
    this.#post(colours, colours.buffer, this.#step, this.#distances);
  }

  rest(viewer, waitMs) {
    if (waitMs < REST_MS || this.#isResting || !this.#step?.isFinal) return;
    // What the last frame has hit may ask for other tiles, which are on their way.
    if (!JSON.parse(viewer.frame()).isSettled) return;
    this.#isResting = true;
    postMessage({ op: 'rest' });
  }

  async drawn(gpu, step) {
    const [camera, colours, bytes] = [this.#frameCamera, this.#canvas.transferToImageBitmap(), gpu.distances()];
    this.#post(colours, colours, step, new Float32Array((await bytes).buffer), camera);
  }

  #post(colours, owned, { width, height }, distances, camera = this.#frameCamera) {
    postMessage({ op: 'cast', camera, width, height, colours, distances }, [owned, distances.buffer]);
  }
}

/** @type {FramePost} */
let post;

class CastEngine extends Engine {
  command(message) {
    if (message.op === 'camera') post.camera = message.camera;
    super.command(message);
  }
}

serve(new CastEngine((options) => (post = new FramePost(options))));
