/** A worker that decodes tiles and draws rows of frames on the CPU, with its own copy of the atlas. */

import init, { RowRenderer, decode_tile } from './insula_web.js';
import initMeshes, { decode_mesh, pack_model } from './insula_web_meshes.js';

/** @type {RowRenderer|null} */
let renderer = null;
/** Jobs wait until the module runs. @type {Promise<unknown>} */
let ready = Promise.resolve();

const jobs = {
  init({ module }) {
    ready = init({ module_or_path: module });
  },

  /** The module that the jobs about meshes need. */
  meshes({ module }) {
    return initMeshes({ module_or_path: module });
  },

  /** Makes an empty atlas, or none: on a GPU, rows are not drawn here. */
  renderer({ cacheBytes }) {
    renderer?.free();
    renderer = cacheBytes > 0 ? new RowRenderer(cacheBytes) : null;
  },

  write({ words }) {
    renderer?.write(words);
  },

  frame({ words }) {
    renderer?.begin(words);
  },

  draw({ number, first, end, step }) {
    const words = renderer?.draw(first, end, step) ?? new Uint32Array();
    const hit = renderer?.take_hits() ?? new Uint32Array();
    postMessage({ number, words, hit }, [words.buffer, hit.buffer]);
  },

  probe({ number, words }) {
    postMessage({ number, word: renderer?.probe(words) ?? 0 });
  },

  decode({ number, key, bytes }) {
    answer(number, () => decode_tile(key, bytes));
  },

  decodeMesh({ number, key, bytes }) {
    answer(number, () => decode_mesh(key, bytes));
  },

  pack({ number, model, origin, positions, colours, triangles, isNamed }) {
    answer(number, () => pack_model(model, new Float64Array(origin), positions, colours, triangles, isNamed));
  },
};

/** Answers with bytes, or with the reason why there are none: the page's console is for other errors. */
function answer(number, make) {
  try {
    const bytes = make();
    postMessage({ number, bytes }, [bytes.buffer]);
  } catch (error) {
    postMessage({ number, error: String(error?.message ?? error) });
  }
}

addEventListener('message', ({ data }) => {
  if (data.job === 'init') jobs.init(data);
  else ready = ready.then(() => jobs[data.job](data)).catch((error) => fail(data, error));
});

/** A job with a number must be answered, or the engine would wait for ever. */
function fail({ number }, error) {
  console.error(error);
  if (number !== undefined) postMessage({ number, error: String(error?.message ?? error) });
}
