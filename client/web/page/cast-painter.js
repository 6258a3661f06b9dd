/** Draws casts into the picture of others, with WebGL 2: colours, and the depth of what they show. */

import { MOVED, OVERLAP, SAME_EYE_M, STILL, pointsOf } from './cast-shaders.js';
import { aboveHeight, castAxes, castToClip, eyeDistance, pixelSize, viewToCast } from './cast-view.js';

/** Draws in one context, until that is lost. */
export class CastPainter {
  #gl;
  #still;
  #moved;
  #vertices;
  #textures;
  /** The frame that the textures have. @type {object|null} */ #frame = null;

  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.#gl = gl;
    this.#still = program(gl, STILL);
    this.#moved = program(gl, MOVED);
    this.#vertices = gl.createVertexArray();
    this.#textures = [gl.createTexture(), gl.createTexture()];
  }

  /** The context that it draws in. */
  get gl() {
    return this.#gl;
  }

  /**
   * Draws a cast as a view sees it. The depth test, its range and its mask are the caller's, and what is bound is not kept.
   * @param {import('./caster.js').Cast} frame
   * @param {import('./cast-view.js').CastView} view
   * @param {number} heightPx Of the screen.
   * @param {number} lowestM What is lower in the city is not drawn.
   */
  draw(frame, view, heightPx, lowestM) {
    const gl = this.#gl;
    const cast = castAxes(frame);
    const isStill = eyeDistance(view, cast) < SAME_EYE_M;
    const { id, at } = isStill ? this.#still : this.#moved;
    gl.useProgram(id);
    gl.bindVertexArray(this.#vertices);
    this.#bind(frame);
    gl.uniform1i(at('colours'), 0);
    gl.uniform1i(at('distances'), 1);
    gl.uniform2f(at('tangents'), cast.tanX, cast.tanY);
    gl.uniform4fv(at('lowest'), aboveHeight(cast, lowestM));
    gl.uniformMatrix4fv(at('castToClip'), false, castToClip(view, cast));
    if (isStill) {
      gl.uniformMatrix3fv(at('viewToCast'), false, viewToCast(view, cast));
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    } else {
      const { stride, count } = pointsOf(frame);
      gl.uniform1i(at('stride'), stride);
      gl.uniform1f(at('pointSize'), OVERLAP * stride * pixelSize(view, cast, frame.height, heightPx));
      gl.drawArrays(gl.POINTS, 0, count);
    }
    gl.bindVertexArray(null);
  }

  dispose() {
    const gl = this.#gl;
    [this.#still, this.#moved].forEach(({ id }) => gl.deleteProgram(id));
    gl.deleteVertexArray(this.#vertices);
    this.#textures.forEach((texture) => gl.deleteTexture(texture));
  }

  #bind(frame) {
    const gl = this.#gl;
    this.#textures.forEach((texture, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.bindSampler(unit, null);
    });
    if (this.#frame === frame) return;
    this.#frame = frame;
    const { width, height, colours, distances } = frame;
    gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, null);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    for (const name of ['ROW_LENGTH', 'SKIP_ROWS', 'SKIP_PIXELS']) gl.pixelStorei(gl[`UNPACK_${name}`], 0);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
    this.#fill(gl.NEAREST, [gl.R32F, width, height, 0, gl.RED, gl.FLOAT, distances]);
    gl.activeTexture(gl.TEXTURE0);
    // A picture has its own size: that of the screen, if the distances are coarser.
    const size = colours instanceof ImageBitmap ? [colours.width, colours.height] : [width, height];
    this.#fill(gl.LINEAR, [gl.RGBA8, ...size, 0, gl.RGBA, gl.UNSIGNED_BYTE, colours]);
  }

  #fill(filter, values) {
    const gl = this.#gl;
    gl.texImage2D(gl.TEXTURE_2D, 0, ...values);
    for (const name of ['MIN', 'MAG']) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}_FILTER`], filter);
    for (const name of ['S', 'T']) gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_WRAP_${name}`], gl.CLAMP_TO_EDGE);
  }
}

/** A linked program, and where its uniforms are. */
function program(gl, { vertex, fragment }) {
  const id = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(id, shader);
    gl.deleteShader(shader);
  }
  gl.linkProgram(id);
  const isLinked = gl.getProgramParameter(id, gl.LINK_STATUS) || gl.isContextLost();
  if (!isLinked) throw new Error(`a shader of the city: ${gl.getProgramInfoLog(id)}`);
  /** @type {Map<string, WebGLUniformLocation|null>} */
  const places = new Map();
  const at = (name) => {
    if (!places.has(name)) places.set(name, gl.getUniformLocation(id, name));
    return places.get(name);
  };
  return { id, at };
}
