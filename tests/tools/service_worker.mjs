/**
 * Runs the page's service worker on made-up caches and a made-up network: node service_worker.mjs SERVICE_WORKER
 *
 * Fails if the worker keeps what it must not, loses what it must not, grows past its limit, lists what it keeps, or answers a request worse
 * than the network would.
 */
import assert from 'node:assert';
import fs from 'node:fs';
import vm from 'node:vm';

const code = fs.readFileSync(process.argv[2], 'utf8');
const ORIGIN = 'https://h';
const PAGE = `${ORIGIN}/cities/a`;
const ASSET = `${ORIGIN}/assets/0123456789abcdef/app.js`;
const ARCHIVE = `${ORIGIN}/site/cities/a/blockmaps.pmtiles?v=1`;
const MANIFEST = `${ORIGIN}/v1/cities/a`;
const tile = (number) => `${ORIGIN}/v1/cities/a/v1/blockmaps/12/${number}/0`;

/** The worker's seconds are shorter. */
const TIMES_FASTER = 10;
const sooner = (act, ms) => setTimeout(act, ms / TIMES_FASTER);

/** A browser that runs the worker. */
class World {
  stores = new Map();
  answers = new Map();
  isOnline = true;
  hasCaches = true;
  isHanging = false;
  quota = 1e12;
  maxBytes = Infinity;
  #handlers = {};

  constructor() {
    const self = {
      addEventListener: (name, handler) => (this.#handlers[name] = handler),
      location: { origin: ORIGIN },
      skipWaiting: async () => {},
      clients: { claim: async () => {}, matchAll: async () => [{ url: PAGE }] },
    };
    const caches = {
      open: (name) => this.#working(() => this.#cache(name)),
      keys: () => this.#working(() => [...this.stores.keys()]),
      delete: async (name) => this.stores.delete(name),
    };
    const navigator = { storage: { estimate: async () => ({ quota: this.quota }) } };
    const indexedDB = { deleteDatabase() {} };
    const fetch = (request, options) => this.#fetch(request, options);
    const given = { self, caches, fetch, navigator, indexedDB };
    const builtIn = { Response, Request, Headers, URL, Blob, AbortController, setTimeout: sooner, clearTimeout, console };
    vm.runInContext(code, vm.createContext({ ...given, ...builtIn }));
  }

  get bytes() {
    return [...this.stores.values()].flatMap((store) => [...store.values()]).reduce((sum, { body }) => sum + body.length, 0);
  }

  async #working(act) {
    if (this.isHanging) await new Promise(() => {});
    if (!this.hasCaches) throw new Error('no caches');
    return act();
  }

  #cache(name) {
    if (!this.stores.has(name)) this.stores.set(name, new Map());
    const store = this.stores.get(name);
    return {
      match: async (key) => {
        const found = store.get(key);
        return found && new Response(found.body, { headers: found.headers });
      },
      put: async (key, response) => {
        const body = new Uint8Array(await response.arrayBuffer());
        if (this.bytes + body.length > this.maxBytes) throw Object.assign(new Error('full'), { name: 'QuotaExceededError' });
        store.set(key, { body, headers: [...response.headers] });
      },
      // What browsers do of a large cache.
      keys: async () => assert.fail('the worker lists what it keeps'),
      matchAll: async () => assert.fail('the worker lists what it keeps'),
    };
  }

  async #fetch(request, { signal } = {}) {
    if (!this.isOnline) throw new TypeError('offline');
    const aborted = new Promise((_, reject) => signal?.addEventListener('abort', () => reject(signal.reason)));
    const answer = this.answers.get(request.url ?? request)?.(request, aborted) ?? new Response('', { status: 404 });
    return Promise.race([answer, aborted]);
  }

  /** The answer to a request, once the worker's work for it is done. */
  async get(url, { isPage = false, range } = {}) {
    const request = new Request(url, range ? { headers: { range } } : {});
    if (isPage) Object.defineProperty(request, 'mode', { value: 'navigate' });
    const works = [];
    let answer;
    this.#handlers.fetch({ request, respondWith: (given) => (answer = given), waitUntil: (work) => works.push(work) });
    const response = await (answer ?? this.#fetch(request));
    if (!this.isHanging) await Promise.all(works);
    return response;
  }

  async activate() {
    const works = [];
    this.#handlers.activate({ waitUntil: (work) => works.push(work) });
    await Promise.all(works);
  }
}

function bytes(count, headers = {}) {
  return () => new Response(new Uint8Array(count).fill(7), { headers: { 'content-type': 'application/octet-stream', ...headers } });
}

function text(content, type) {
  return () => new Response(content, { headers: { 'content-type': type } });
}

/** Content whose last part comes late, unless the request is aborted before. */
function slowText(content, type) {
  return (_, aborted) => {
    const start = (stream) => {
      stream.enqueue(new TextEncoder().encode(content.slice(0, 1)));
      const end = () => {
        stream.enqueue(new TextEncoder().encode(content.slice(1)));
        stream.close();
      };
      const timer = sooner(end, 5_000);
      aborted.catch((reason) => {
        clearTimeout(timer);
        stream.error(reason);
      });
    };
    return new Response(new ReadableStream({ start }), { headers: { 'content-type': type } });
  };
}

function redirected() {
  const response = bytes(9)();
  Object.defineProperty(response, 'redirected', { value: true });
  return response;
}

const tests = {
  async 'what was visited is there without a network'() {
    const world = new World();
    const html = '<script src="/assets/0123456789abcdef/app.js">';
    world.answers.set(PAGE, text(html, 'text/html')).set(ASSET, text('let a;', 'text/javascript')).set(tile(1), bytes(10));
    for (const isOnline of [true, false]) {
      world.isOnline = isOnline;
      assert.equal(await (await world.get(PAGE, { isPage: true })).text(), html);
      assert.equal((await world.get(ASSET)).status, 200);
      assert.equal((await (await world.get(tile(1))).arrayBuffer()).byteLength, 10);
    }
  },
  async 'what must not be kept is not'() {
    const others = ['text/html', 'text/plain; charset=utf-8', 'application/json'].map((type) => text('Log in!', type));
    for (const answer of [bytes(9, { 'cache-control': 'private, No-Store' }), redirected, ...others]) {
      const world = new World();
      world.answers.set(tile(1), answer).set(PAGE, text('{}', 'application/json'));
      await world.get(tile(1));
      await world.get(PAGE, { isPage: true });
      world.isOnline = false;
      await assert.rejects(world.get(tile(1)));
      await assert.rejects(world.get(PAGE, { isPage: true }));
    }
  },
  async 'files are kept with the types that hosts send for them, and with no other'() {
    const asset = (name) => `${ORIGIN}/assets/0123456789abcdef/${name}`;
    for (const [address, type, isKept] of [
      [asset('app.js'), 'application/javascript', true],
      [asset('app.js'), 'text/plain', false],
      [asset('style.css'), 'text/css; charset=utf-8', true],
      [asset('insula_web_bg.wasm'), 'application/wasm', true],
      [asset('insula_web_bg.wasm'), 'binary/octet-stream', true],
      [asset('insula_web_bg.wasm'), 'text/plain', true],
      [asset('style.css'), 'text/plain', false],
      [asset('shaders.txt'), 'text/plain; charset=utf-8', true],
      [asset('shaders.txt'), 'text/html', false],
      [asset('icon.svg'), 'image/svg+xml', true],
      [asset('icon-192.png'), 'image/png', true],
      [asset('icon-192.png'), 'text/html', false],
      [asset('language-de.json'), 'application/json', true],
      [asset('manifest.webmanifest'), 'application/manifest+json', true],
      [`${ORIGIN}/cities/a/thumbnail.jpg`, 'image/jpeg', true],
      [`${ORIGIN}/cities/a/city.json`, 'application/json', true],
      [`${ORIGIN}/cities/a/city.json`, 'text/html', false],
      [`${ORIGIN}/v1/cities`, 'application/json', true],
      [MANIFEST, 'text/plain', false],
    ]) {
      const world = new World();
      world.answers.set(address, text('content', type));
      await world.get(address);
      world.isOnline = false;
      assert.equal(await world.get(address).then(Boolean, () => false), isKept, `${address}: ${type}`);
    }
    const world = new World();
    world.answers.set(ASSET, () => new Response(new Uint8Array(9)));
    await world.get(ASSET);
    world.isOnline = false;
    assert.equal((await world.get(ASSET)).status, 200, 'a host that names no type');
  },
  async 'a slow answer is waited for, and a kept one shown where none begins'() {
    const world = new World();
    const json = (version, make = text) => make(`{"version": ${version}}`, 'application/json');
    world.answers.set(MANIFEST, json(1));
    await world.get(MANIFEST);
    world.answers.set(MANIFEST, json(2, slowText));
    for (const isOnline of [true, false]) {
      world.isOnline = isOnline;
      assert.deepEqual(await (await world.get(MANIFEST)).json(), { version: 2 });
    }
    world.isOnline = true;
    world.answers.set(MANIFEST, () => new Promise(() => {}));
    assert.deepEqual(await (await world.get(MANIFEST)).json(), { version: 2 });
  },
  async 'caches that fail or hang leave everything to the network'() {
    for (const fault of ['hasCaches', 'isHanging']) {
      const world = new World();
      world[fault] = fault === 'isHanging';
      world.answers.set(tile(1), bytes(5)).set(PAGE, text('page', 'text/html'));
      world.answers.set(ARCHIVE, () => new Response('0123', { status: 206, headers: { 'content-range': 'bytes 0-3/9' } }));
      const documents = [MANIFEST, `${ORIGIN}/site/cities/a/city.json`, `${ORIGIN}/v1/cities`];
      for (const address of documents) world.answers.set(address, text('{}', 'application/json'));
      for (const address of [tile(1), ...documents]) assert.equal((await world.get(address)).status, 200);
      assert.equal((await world.get(PAGE, { isPage: true })).status, 200);
      assert.equal((await world.get(ARCHIVE, { range: 'bytes=0-3' })).status, 206);
    }
  },
  async 'a full storage makes room and answers'() {
    const world = new World();
    world.maxBytes = 500;
    for (let number = 0; number < 40; number++) {
      world.answers.set(tile(number), bytes(100));
      assert.equal((await world.get(tile(number))).status, 200);
    }
    world.isOnline = false;
    assert.equal((await world.get(tile(39))).status, 200);
  },
  async 'the oldest goes, and what is used stays'() {
    const world = new World();
    world.quota = 400_000;
    for (let number = 0; number < 1000; number++) {
      world.answers.set(tile(number), bytes(1000));
      await world.get(tile(number));
      if (number % 10 === 0) await world.get(tile(0));
      assert.ok(world.stores.size <= 2 && world.bytes < 130_000);
    }
    world.isOnline = false;
    assert.equal((await world.get(tile(0))).status, 200);
    assert.equal((await world.get(tile(999))).status, 200);
    await assert.rejects(world.get(tile(1)));
  },
  async 'a range in a kept one is found, of the same version only'() {
    const world = new World();
    const file = Uint8Array.from({ length: 1000 }, (_, at) => at % 251);
    world.answers.set(ARCHIVE, ({ headers }) => {
      const [first, last] = headers.get('range').slice(6).split('-').map(Number);
      const about = { 'content-range': `bytes ${first}-${last}/1000` };
      return new Response(file.slice(first, last + 1), { status: 206, headers: about });
    });
    await world.get(ARCHIVE, { range: 'bytes=100-299' });
    world.isOnline = false;
    const part = await world.get(ARCHIVE, { range: 'bytes=150-159' });
    assert.deepEqual([part.status, part.headers.get('content-range')], [206, 'bytes 150-159/1000']);
    assert.deepEqual(new Uint8Array(await part.arrayBuffer()), file.slice(150, 160));
    assert.equal((await world.get(ARCHIVE, { range: 'bytes=100-299' })).status, 206);
    await assert.rejects(world.get(ARCHIVE.replace('v=1', 'v=2'), { range: 'bytes=150-159' }));
  },
  async 'ranges that were fetched at once are found, also across several'() {
    const world = new World();
    const content = Uint8Array.from({ length: 600_000 }, (_, i) => (i * 7919) % 251);
    world.answers.set(ARCHIVE, ({ headers }) => {
      const [first, last] = headers.get('range').slice(6).split('-').map(Number);
      return new Response(content.slice(first, last + 1), { status: 206, headers: { 'content-range': `bytes ${first}-${last}/600000` } });
    });
    const get = async (first, last) => {
      const response = await world.get(ARCHIVE, { range: `bytes=${first}-${last}` });
      assert.equal(response.headers.get('content-range'), `bytes ${first}-${last}/600000`);
      assert.deepEqual(new Uint8Array(await response.arrayBuffer()), content.slice(first, last + 1));
    };
    const places = Array.from({ length: 150 }, (_, i) => 200_000 + i * 1000);
    // As a page asks; one that continues another, one that overlaps it, and some without a gap.
    await Promise.all(places.map((place, i) => get(place, place + [999, 1020, 499][i % 3])));
    world.isOnline = false;
    await Promise.all(places.map((place) => get(place + 10, place + 400)));
    await get(200_500, 202_400);
    // From one block to the next.
    await get(261_100, 262_499);
    await assert.rejects(get(202_400, 203_100), 'a gap');
  },
  async 'addresses that are keys of the cache are left to the network'() {
    const world = new World();
    const count = `${ORIGIN}/?insula-bytes`;
    world.answers.set(count, text('page', 'text/html')).set(tile(1), bytes(2 ** 20));
    await world.get(tile(1));
    assert.equal(await (await world.get(count, { isPage: true })).text(), 'page');
    const kept = [...world.stores.values()].map((store) => store.get(count)).filter(Boolean);
    assert.ok(kept.every(({ body }) => Number(new TextDecoder().decode(body)) > 0), 'a page in the place of the count');
    world.isOnline = false;
    await assert.rejects(world.get(count, { isPage: true }));
  },
  async 'an upgrade removes what older workers kept, and keeps the open page'() {
    const world = new World();
    world.stores.set('insula-1', new Map()).set('other', new Map());
    world.answers.set(PAGE, text('page', 'text/html'));
    await world.activate();
    assert.ok(!world.stores.has('insula-1') && world.stores.has('other'));
    world.isOnline = false;
    assert.equal((await world.get(PAGE, { isPage: true })).status, 200);
  },
};

for (const [name, test] of Object.entries(tests)) {
  await test();
  console.log(`ok: ${name}`);
}
// Timers of caches that hang.
process.exit(0);
