/** Requests of the engine: limited in bytes and in time. */

/** A response may take this long, and a second longer for each 256 bytes that have arrived. */
const TIMEOUT_MS = 15000;
const MS_PER_BYTE = 1000 / 256;
/** Longest time of a response, whatever its length. */
const MAX_MS = 600_000;
/** Caches are passed by for this long after damaged bytes came. */
const BYPASS_MS = 30_000;
const MAX_MANIFEST_BYTES = 4 << 20;

/** What Rust sees of a response. */
class Answer {
  /** @param {{status?: number, error?: string, tooLong?: boolean, bytes?: Uint8Array, headers?: Headers}} parts */
  constructor({ status = 0, error, tooLong = false, bytes = new Uint8Array(), headers }) {
    Object.assign(this, { status, error, tooLong, bytes });
    this.headers = headers;
  }

  header(name) {
    return this.headers?.get(name) ?? undefined;
  }
}

export class Network {
  /** @type {Map<number, AbortController>} */
  #controllers = new Map();
  requests = 0;
  bytes = 0;
  #bypassUntil = -Infinity;

  /** See `Host::fetch` of the crate. */
  fetch(url, range, limit, request) {
    return this.#send(url, range ? { range } : {}, limit, request);
  }

  /**
   * Fetches the text of a manifest. `null` if there is none. Fails if the host does not answer, or if it is too long.
   * @param {string} url
   * @returns {Promise<string|null>}
   */
  async manifest(url) {
    const { status, error, tooLong, bytes } = await this.#send(url, { accept: 'application/json' }, MAX_MANIFEST_BYTES, 0);
    if (status === 404 || status === 403) return null;
    if (tooLong) throw new Error(`${url}: too long for a manifest`);
    if (error || status !== 200) throw failure(`${url}: ${error ?? `status ${status}`}`, status);
    const text = new TextDecoder().decode(bytes);
    return text.trimStart().startsWith('{') ? text : null;
  }

  async #send(url, headers, limit, request) {
    const controller = new AbortController();
    this.#controllers.set(request, controller);
    this.requests++;
    try {
      return await this.#get(url, headers, limit, controller);
    } catch (error) {
      return new Answer({ error: error?.name === 'AbortError' ? 'no answer in time' : String(error?.message ?? error) });
    } finally {
      this.#controllers.delete(request);
    }
  }

  /** See `Host::bypass_caches` of the crate. */
  bypassCaches() {
    this.#bypassUntil = performance.now() + BYPASS_MS;
  }

  abort(request) {
    this.#controllers.get(request)?.abort();
  }

  async #get(url, headers, limit, controller) {
    const begin = performance.now();
    let timer = setTimeout(() => controller.abort(), TIMEOUT_MS);
    try {
      const cache = begin < this.#bypassUntil ? 'reload' : 'default';
      const response = await fetch(url, { headers, cache, signal: controller.signal, credentials: 'same-origin' });
      const { status } = response;
      if (status !== 200 && status !== 206) {
        controller.abort();
        return new Answer({ status, headers: response.headers });
      }
      const chunks = [];
      let length = 0;
      for await (const chunk of chunksOf(response)) {
        length += chunk.length;
        this.bytes += chunk.length;
        // A host without ranges answers with the whole file: its status says so, and its body is of no use.
        if (length > limit) {
          controller.abort();
          return new Answer({ status, headers: response.headers, tooLong: !(headers.range && status === 200) });
        }
        chunks.push(chunk);
        clearTimeout(timer);
        const allowedMs = Math.min(TIMEOUT_MS + length * MS_PER_BYTE, MAX_MS);
        timer = setTimeout(() => controller.abort(), begin + allowedMs - performance.now());
      }
      return new Answer({ status, headers: response.headers, bytes: joined(chunks, length) });
    } finally {
      clearTimeout(timer);
    }
  }
}

/** Not every browser iterates over streams. */
async function* chunksOf(response) {
  const reader = response.body?.getReader();
  while (reader) {
    const { done, value } = await reader.read();
    if (done) return;
    yield value;
  }
}

function joined(chunks, length) {
  if (chunks.length === 1) return chunks[0];
  const all = new Uint8Array(length);
  let at = 0;
  for (const chunk of chunks) {
    all.set(chunk, at);
    at += chunk.length;
  }
  return all;
}

/**
 * An error with `isTemporary`: whether another attempt may help. Without a status, the host did not answer.
 * @param {string} text
 * @param {number} status
 */
function failure(text, status) {
  return Object.assign(new Error(text), { isTemporary: status === 0 || status === 429 || status >= 500 });
}

/** A file of the viewer. Fails if it cannot be fetched. @param {string} name @param {URL} url @returns {Promise<Response>} */
async function ownFile(name, url) {
  const response = await fetch(url).catch(({ message }) => {
    throw failure(`${name}: ${message}`, 0);
  });
  if (!response.ok) throw failure(`${name}: status ${response.status}`, response.status);
  return response;
}

/** The text of the shaders, which only a GPU needs. Fails if it cannot be fetched. @returns {Promise<string>} */
export async function fetchShaders() {
  // As a whole: bundlers follow it.
  return (await ownFile('shaders.txt', new URL('./shaders.txt', import.meta.url))).text();
}

/** Compiles the viewer. Fails if it cannot be fetched. @returns {Promise<WebAssembly.Module>} */
export function compileViewer() {
  // As a whole: bundlers follow it.
  return compile('insula_web_bg.wasm', new URL('./insula_web_bg.wasm', import.meta.url));
}

/** Compiles what draws on a GPU. Fails if it cannot be fetched. @returns {Promise<WebAssembly.Module>} */
export function compileGpu() {
  return compile('insula_web_gpu_bg.wasm', new URL('./insula_web_gpu_bg.wasm', import.meta.url));
}

/** Compiles what decodes meshes and packs models. Fails if it cannot be fetched. @returns {Promise<WebAssembly.Module>} */
export function compileMeshes() {
  return compile('insula_web_meshes_bg.wasm', new URL('./insula_web_meshes_bg.wasm', import.meta.url));
}

/** Compiles what reads objects, which only questions about them need. Fails if it cannot be fetched. @returns {Promise<WebAssembly.Module>} */
export function compileObjects() {
  return compile('insula_web_objects_bg.wasm', new URL('./insula_web_objects_bg.wasm', import.meta.url));
}

/** @param {string} name @param {URL} url @returns {Promise<WebAssembly.Module>} */
async function compile(name, url) {
  const response = await ownFile(name, url);
  // Static hosts may not know the type, and compiling a stream demands it.
  const type = response.headers.get('content-type') ?? '';
  if (type.startsWith('application/wasm')) return WebAssembly.compileStreaming(response);
  return WebAssembly.compile(await response.arrayBuffer());
}

/**
 * Where the tiles of a city are: `.../v1/cities/NAME` on a server, the page `.../cities/NAME` of one, or a baked city's folder.
 * @param {Network} network
 * @param {string} src An absolute URL.
 * @param {object|null} known The manifest, if the page has it.
 * @returns {Promise<{manifest: string, base: string, isFolder: boolean, query: string}>}
 */
export async function locate(network, src, known) {
  const url = new URL(src);
  const share = url.searchParams.get('share');
  const query = share ? `?share=${encodeURIComponent(share)}` : '';
  const path = url.pathname.replace(/\/+$/, '');
  const city = /^(.*?)(\/v1)?\/cities\/([a-z0-9_-]{1,64})$/.exec(path);
  const folder = { base: url.origin + path, isFolder: true, query: '' };
  const server = city && { base: url.origin + city[1], isFolder: false, query };
  if (known) return { ...(city?.[2] ? server : folder), manifest: JSON.stringify(known) };
  if (server) {
    // A plain host may answer wrong addresses without the header that lets other sites read the answer: that looks like no answer.
    const address = `${server.base}/v1/cities/${city[3]}${query}`;
    const manifest = await network.manifest(address).catch(async (error) => {
      const other = error.isTemporary ? await network.manifest(`${folder.base}/city.json`).catch(() => null) : null;
      if (other === null) throw error;
      Object.assign(server, folder);
      return other;
    });
    if (manifest) return { ...server, manifest };
  }
  const manifest = await network.manifest(`${folder.base}/city.json`);
  if (manifest) return { ...folder, manifest };
  throw new Error(`${src}: there is no city here`);
}
