// The front end of insula.Map (https://anywidget.dev): the element <insula-city>, whose modules and tiles come over the kernel's channel.
//
// The viewer is one set of modules that name each other by address. Blobs have no addresses beside them, so the modules get BASE as
// theirs, and what they start or fetch there is answered here. Each city has a path of its own below it.

const BASE = 'https://insula.invalid/';
/** Each has a script and `_bg.wasm`. */
const MODULES = ['insula_web', 'insula_web_gpu', 'insula_web_meshes', 'insula_web_objects'];
const CAMERA_MS = 200;
/** Of a camera in degrees that does not say it, as for `City.render`. */
const DEFAULT_FOV_DEG = 60;
const TRIAL_MS = 1500;
/** A kernel that runs a cell answers later. */
const PATIENCE_MS = 600_000;
const OWN_HOSTS = ['localhost', '127.0.0.1', '[::1]'];

/** What all maps of a page share. @type {{routes: Map<string, Channel>, viewer: Promise<void>|null}} */
const page = (globalThis[Symbol.for('insula.map')] ??= { routes: new Map(), viewer: null });

/** Requests of one map, which its kernel or its server answers. */
class Channel {
  #model;
  #waiting = new Map();
  #last = 0;
  /** Another one in each view: answers come to all views of a map, in all windows. */
  key = `city-${Math.random().toString(36).slice(2)}`;
  /** Address of the server, if it can be asked directly. */
  direct = '';
  /** What the server wants to see, if it is one of the kernel's own. @type {Record<string, string>} */
  #credentials = {};
  #receive = (content, buffers) => {
    const request = content?.kind === 'answer' && this.#waiting.get(content.id);
    if (!request) return;
    this.#waiting.delete(content.id);
    if (content.error) request.reject(new TypeError(content.error));
    else request.resolve({ ...content, body: bytesOf(buffers?.[0]) });
  };

  constructor(model) {
    this.#model = model;
    model.on('msg:custom', this.#receive);
  }

  close() {
    this.#model.off('msg:custom', this.#receive);
    this.#waiting.forEach(({ reject }) => reject(new TypeError('the map is closed')));
  }

  /** Finds out whether the server of the kernel is on this machine. Pages of other hosts do not ask: browsers would ask their users. */
  async find(transport) {
    const [address, name, version] = ['_address', '_name', '_version'].map((trait) => this.#model.get(trait));
    if (transport === 'kernel' || !OWN_HOSTS.includes(location.hostname)) return;
    const signal = AbortSignal.timeout(TRIAL_MS);
    const token = this.#model.get('_token');
    this.#credentials = token ? { authorization: `Bearer ${token}` } : {};
    const manifest = await fetch(`${address}/v1/cities/${name}`, { headers: this.#credentials, signal }).then((answer) => answer.json(), () => null).catch(() => null);
    if (manifest?.version === version) this.direct = address;
  }

  /** @returns {Promise<{status: number, headers: Record<string, string>, body: Uint8Array}>} */
  async fetch(path, range, signal) {
    if (this.direct) {
      const headers = { ...this.#credentials, ...(range ? { range } : {}) };
      const answer = await fetch(this.direct + path, { headers, signal });
      const kept = Object.fromEntries(answer.headers);
      delete kept['content-encoding'];
      return { status: answer.status, headers: kept, body: new Uint8Array(await answer.arrayBuffer()) };
    }
    const id = `${this.key}-${++this.#last}`;
    const answer = await new Promise((resolve, reject) => {
      const give = (text) => () => this.#waiting.delete(id) && reject(new TypeError(text));
      const timer = setTimeout(give('the kernel does not answer'), PATIENCE_MS);
      signal?.addEventListener('abort', give('aborted'));
      const end = (settle) => (value) => (clearTimeout(timer), settle(value));
      this.#waiting.set(id, { resolve: end(resolve), reject: end(reject) });
      this.#model.send({ kind: 'fetch', id, path, range });
    });
    const { 'content-encoding': coding, ...headers } = answer.headers;
    return coding ? { ...answer, headers, body: await unpacked(answer.body, coding) } : answer;
  }
}

/** Buffers of messages are views, or copies of them. */
function bytesOf(buffer) {
  if (!buffer) return new Uint8Array();
  return ArrayBuffer.isView(buffer) ? new Uint8Array(buffer.buffer, buffer.byteOffset, buffer.byteLength) : new Uint8Array(buffer);
}

async function unpacked(bytes, coding) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream(coding));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** What stands above the modules of a worker: its `fetch` asks the page, and its workers are those of this file. */
function workerHead(helperUrl) {
  return `
const insulaWaiting = new Map();
let insulaLast = 0;
const insulaPort = new Promise((resolve) => {
  addEventListener('message', function take(event) {
    if (!event.data?.insulaPort) return;
    event.stopImmediatePropagation();
    removeEventListener('message', take);
    const port = event.data.insulaPort;
    port.onmessage = ({ data }) => {
      insulaWaiting.get(data.id)?.(data);
      insulaWaiting.delete(data.id);
    };
    resolve(port);
  });
});
const fetch = async (input, { headers = {}, signal } = {}) => {
  const url = String(input);
  if (!url.startsWith(${JSON.stringify(BASE)})) throw new TypeError('not of this city: ' + url);
  const port = await insulaPort;
  const id = ++insulaLast;
  const answer = await new Promise((resolve, reject) => {
    insulaWaiting.set(id, resolve);
    signal?.addEventListener('abort', () => {
      insulaWaiting.delete(id);
      port.postMessage({ id, isAborted: true });
      reject(new DOMException('aborted', 'AbortError'));
    });
    port.postMessage({ id, path: url.slice(${BASE.length}), range: headers.range });
  });
  if (answer.error) throw new TypeError(answer.error);
  const { status, body } = answer;
  return new Response(status === 204 || status === 304 ? null : body, { status, headers: answer.headers });
};
const Worker = class extends globalThis.Worker {
  constructor(_, options) {
    super(${JSON.stringify(helperUrl)}, options);
  }
};
`;
}

/** Answers a worker's requests. @param {MessagePort} port @param {Map<string, Uint8Array>} modules */
function answer(port, modules) {
  const running = new Map();
  port.onmessage = async ({ data: { id, path, range, isAborted } }) => {
    if (isAborted) return running.get(id)?.abort();
    const control = new AbortController();
    running.set(id, control);
    try {
      const [key, rest] = [path.slice(0, path.indexOf('/')), path.slice(path.indexOf('/'))];
      const channel = page.routes.get(key);
      const wasm = modules.get(path);
      if (!wasm && !channel) throw new TypeError('the map is closed');
      const found = wasm
        ? { status: 200, headers: { 'content-type': 'application/wasm' }, body: wasm }
        : await channel.fetch(rest, range, control.signal);
      port.postMessage({ id, status: found.status, headers: found.headers, body: found.body });
    } catch (error) {
      port.postMessage({ id, error: String(error?.message ?? error) });
    } finally {
      running.delete(id);
    }
    return undefined;
  };
}

const script = (text) => URL.createObjectURL(new Blob([text], { type: 'text/javascript' }));

/** Defines the element, with the modules of a server. */
async function loadViewer(channel, assets) {
  const wasmNames = MODULES.map((name) => `${name}_bg.wasm`);
  const names = ['insula-city.js', 'engine.js', 'helper.js', ...MODULES.map((name) => `${name}.js`), ...wasmNames];
  const answers = await Promise.all(names.map((name) => channel.fetch(assets + name)));
  const missing = names.filter((_, i) => answers[i].status !== 200);
  if (missing.length > 0) throw new Error(`the server has no ${missing.join(', ')}`);
  const modules = new Map(answers.splice(-MODULES.length).map(({ body }, i) => [wasmNames[i], body]));
  const texts = answers.map(({ body }) => new TextDecoder().decode(body).replaceAll('import.meta.url', JSON.stringify(BASE)));
  const [element, engine, helper, ...bindings] = texts;
  const bound = bindings.map((text) => JSON.stringify(script(text)));
  const bind = (text, name, i) => text.replaceAll(`'./${name}.js'`, bound[i]).replaceAll(`"./${name}.js"`, bound[i]);
  const withBindings = (text) => MODULES.reduce(bind, text);
  const helperUrl = script(withBindings(helper));
  const engineUrl = script(workerHead(helperUrl) + withBindings(engine));
  page.Worker = class extends Worker {
    constructor(_, options) {
      super(engineUrl, options);
      const { port1, port2 } = new MessageChannel();
      answer(port1, modules);
      this.postMessage({ insulaPort: port2 }, [port2]);
    }
  };
  await import(script(`const { Worker } = globalThis[Symbol.for('insula.map')];\n${element}`));
}

/** Where the element goes for a text: `LON,LAT,HEIGHT,HEADING,PITCH[,FOV]` in degrees and metres, or that of a link, which has metres. */
function placeOf(text) {
  if (text.includes('camera=')) return text.split('camera=')[1].split(/[&#]/)[0];
  const [lon, lat, height, heading, pitch, fov = DEFAULT_FOV_DEG] = text.split(',').map(Number);
  return { lon, lat, height, heading, pitch, fov };
}

/** Lets a trait and the element follow each other. Returns what ends that. */
function connect(model, city) {
  const set = (name, value) => {
    model.set(name, value);
    model.save_changes();
  };
  let timer = 0;
  city.addEventListener('camera', ({ detail }) => {
    clearTimeout(timer);
    timer = setTimeout(() => set('camera', `camera=${detail.camera}`), CAMERA_MS);
  });
  city.addEventListener('pick', ({ detail: { adds, error, fault, ...rest } }) => set('picked', rest));
  city.addEventListener('selection', ({ detail }) => set('selection', detail.objects.map(({ id }) => id)));
  city.addEventListener('ready', () => set('status', 'ready'));
  city.addEventListener('status', ({ detail }) => detail.kind === 'error' && set('status', detail.text));
  const report = (error) => set('status', String(error?.message ?? error));

  let colored = {};
  const follow = {
    height: () => (city.style.blockSize = `${model.get('height')}px`),
    camera: () => {
      const wanted = model.get('camera');
      if (wanted && wanted !== `camera=${city.view?.camera}`) city.flyTo(placeOf(wanted)).catch(report);
    },
    time: () => model.get('time') && city.setTime(model.get('time')),
    selection: () => {
      const [now, wanted] = [city.selection.map(({ id }) => id), model.get('selection')];
      if (String(now) !== String(wanted)) city.select(wanted).catch(report);
    },
    colors: () => {
      const wanted = model.get('colors');
      try {
        Object.keys(colored).filter((id) => !(id in wanted)).forEach((id) => city.setFeatureState(Number(id), null));
        Object.entries(wanted).forEach(([id, color]) => colored[id] !== color && city.setFeatureState(Number(id), { color }));
      } catch (error) {
        report(error);
      }
      colored = { ...wanted };
    },
    rules: () => city.setColors(Object.keys(model.get('rules')).length > 0 ? model.get('rules') : null).catch(report),
  };
  const names = Object.keys(follow);
  names.forEach((name) => model.on(`change:${name}`, follow[name]));
  const start = () => {
    follow.colors();
    if (model.get('selection').length > 0) follow.selection();
    if (Object.keys(model.get('rules')).length > 0) follow.rules();
  };
  city.addEventListener('ready', start, { once: true });
  return () => {
    clearTimeout(timer);
    names.forEach((name) => model.off(`change:${name}`, follow[name]));
  };
}

async function render({ model, el }) {
  const channel = new Channel(model);
  const { key } = channel;
  page.routes.set(key, channel);
  const close = () => {
    page.routes.delete(key);
    channel.close();
  };
  try {
    await channel.find(model.get('transport'));
    page.viewer ??= loadViewer(channel, model.get('_assets'));
    await page.viewer;
  } catch (error) {
    page.viewer = null;
    el.textContent = `Insula: ${error.message}`;
    model.set('status', error.message);
    model.save_changes();
    return close;
  }
  const city = document.createElement('insula-city');
  const first = model.get('camera') && placeOf(model.get('camera'));
  const camera = typeof first === 'string' ? first : '';
  const attributes = { src: `${BASE}${key}/v1/cities/${model.get('_name')}`, camera, time: model.get('time') };
  Object.entries(attributes).forEach(([name, value]) => value && city.setAttribute(name, value));
  city.style.display = 'block';
  city.style.blockSize = `${model.get('height')}px`;
  const disconnect = connect(model, city);
  el.append(city);
  // A place in degrees needs the city.
  if (typeof first === 'object') city.flyTo(first, { seconds: 0 }).catch((error) => console.warn(error));
  return () => {
    disconnect();
    city.remove();
    close();
  };
}

export default { render };
