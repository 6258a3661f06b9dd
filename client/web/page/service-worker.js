/**
 * Keeps visited pages, the viewer's files and tiles for use without a network.
 *
 * Addresses that never change are answered from the cache first; pages and manifests from the network first. There are two caches: what
 * is used moves to the newer one, and when that is full, the older one goes. So nothing lists what is kept. Only GET requests to this host
 * are looked at. Where this script or the cache fails, the network answers.
 */

/** Caches are named by this and a number: the newest is filled, the one before is read, and older ones go. */
const PREFIX = 'insula-2-';
const MAX_BYTES = 256 * 2 ** 20;
/** Share of the space that the browser grants this host. */
const MAX_SHARE = 0.3;
/** Estimated bytes of an entry besides its body. */
const ENTRY_BYTES = 1024;
/** The count of a cache's bytes is stored whenever so many were added. */
const COUNT_BYTES = 2 ** 20;
/** A page that is in the cache waits this long for the network. */
const PATIENCE_MS = 4_000;
/** The cache has this long for an answer. */
const LOOK_UP_MS = 2_000;
/** For ranges in the cache's keys: the cache cannot hold partial responses. */
const RANGE_PARAMETER = 'insula-range';
const BLOCK_PARAMETER = 'insula-block';
const COUNT_PARAMETER = 'insula-bytes';
/** Ranges up to this length can be found by what lies in them: by the blocks of this length that they touch. */
const BLOCK_BYTES = 256 * 2 ** 10;
const MAX_RANGES_OF_BLOCK = 256;

const ASSET = /\/assets\/[0-9a-f]{16}\/[^/]+$/;
const TILE = /\/v1\/cities\/[^/]+\/[^/]+\/((subtrees|blockmaps|meshes|visibility)\/[\d/]+|objects\/(\d+|schema))$/;
const GROUP = /^(.*\/v1\/cities\/[^/]+\/[^/]+\/)groups\/(subtrees|blockmaps|meshes)\/(\d+)\/(\d+)\/(\d+)\/(\d+)\/(\d+)$/;
const GROUP_MAGIC = 'INSG';
const MAX_GROUP_TILES = 64;
/** Of the tiles of a group. */
const MAX_GROUP_BYTES = 65536;
const ARCHIVE = /\/[a-z]+\.pmtiles$/;
const MANIFEST = /(\/city\.json|\/v1\/cities\/[^/]+)$/;
const PAGE_FILE = /\/(thumbnail\.jpg|v1\/cities)$/;
/** Content types of what is kept. Hosts of files may send none, and any for archives: that these are answered by ranges is enough. */
const PAGE_TYPE = /^text\/html\b/i;
const TILE_TYPE = /^$|octet-stream/i;
const RANGE_TYPE = /^(?!text\/html\b)/i;
/** By the end of a file's name; others are JSON. A page is only kept with all of its files, and old hosts do not know two of them. */
const TYPE_WORDS = {
  js: 'javascript',
  css: 'css',
  wasm: 'wasm|^text/plain',
  webmanifest: 'json|^text/plain',
  svg: 'svg',
  png: 'png',
  jpg: 'jpeg',
  woff2: 'woff2',
  txt: '^text/plain',
};
const ASSET_IN_PAGE = /(?:href|src)="([^"]*assets\/[0-9a-f]{16}\/[^"]+)"/g;

self.addEventListener('install', (event) => event.waitUntil(self.skipWaiting()));
self.addEventListener('activate', (event) => event.waitUntil(start()));
self.addEventListener('fetch', (event) => {
  try {
    const answer = answerTo(event.request, event);
    if (answer) event.respondWith(answer.catch(() => fetch(event.request)));
  } catch {
    // The browser fetches as usual.
  }
});

/** Removes what older versions kept, and keeps the pages that are open: they were loaded before this script ran. */
async function start() {
  await self.clients.claim();
  const old = (await caches.keys()).filter((name) => name.startsWith('insula-') && !name.startsWith(PREFIX));
  await Promise.all(old.map((name) => caches.delete(name)));
  indexedDB.deleteDatabase('insula-cache');
  const pages = await self.clients.matchAll({ type: 'window', includeUncontrolled: true });
  const keepOpen = async ({ url }) => {
    const response = await fetch(url);
    if (isKept(response, PAGE_TYPE)) await keepPage(withoutHash(url), response);
  };
  await Promise.all(pages.map((page) => keepOpen(page).catch(() => null)));
}

/**
 * The response to a request; null if the browser should fetch as usual.
 * @param {Request} request
 * @param {ExtendableEvent} event
 * @returns {Promise<Response> | null}
 */
function answerTo(request, event) {
  const url = new URL(request.url);
  if (request.method !== 'GET' || url.origin !== self.location.origin) return null;
  // An address with one of these would be answered by, or written over, what the cache's keys with it have.
  if ([RANGE_PARAMETER, BLOCK_PARAMETER, COUNT_PARAMETER].some((name) => url.searchParams.has(name))) return null;
  const later = (work) => event.waitUntil(work.catch(() => undefined));
  if (request.headers.has('range')) {
    return ARCHIVE.test(url.pathname) ? rangeOf(request, later) : null;
  }
  if (ASSET.test(url.pathname) || TILE.test(url.pathname)) return fromCacheFirst(request, later);
  if (GROUP.test(url.pathname)) return groupOf(request, later);
  const isPage = request.mode === 'navigate';
  if (isPage || MANIFEST.test(url.pathname) || PAGE_FILE.test(url.pathname)) return fromNetworkFirst(request, isPage, later);
  return null;
}

/** @param {Request} request @param {(work: Promise<unknown>) => void} later */
async function fromCacheFirst(request, later) {
  const found = await lookUpUnlessReloaded(request, request.url);
  if (found) return found;
  const response = await fetch(request);
  const { pathname } = new URL(request.url);
  if (isKept(response, TILE.test(pathname) ? TILE_TYPE : fileType(pathname))) later(keep(request.url, response.clone()));
  return response;
}

/**
 * A group of tiles. It is kept as single tiles, and without a network made of those.
 * @param {Request} request @param {(work: Promise<unknown>) => void} later
 */
async function groupOf(request, later) {
  const url = new URL(request.url);
  try {
    const response = await fetch(request);
    if (isKept(response, TILE_TYPE)) later(keepTilesOf(url, response.clone()));
    return (response.status >= 500 && (await groupOfKept(url))) || response;
  } catch (error) {
    const kept = await groupOfKept(url);
    if (kept) return kept;
    throw error;
  }
}

/** The addresses of the tiles of a group, in its order. @param {URL} url @returns {string[]} */
function addressesOf(url) {
  const [base, kind, ...numbers] = GROUP.exec(url.pathname)?.slice(1) ?? [];
  const [level, x, y, count, lod] = numbers.map(Number);
  if (!(count <= MAX_GROUP_TILES)) return [];
  const lodPath = kind === 'meshes' ? `/${lod}` : '';
  const width = 2 ** Math.ceil(Math.log2(count) / 2);
  const address = (_, place) => {
    const node = `${level}/${x + (place % width)}/${y + Math.floor(place / width)}`;
    return new URL(`${base}${kind}/${node}${lodPath}${url.search}`, url).href;
  };
  return Array.from({ length: count }, address);
}

/** Keeps each tile of a group under its own address. @param {URL} url @param {Response} response */
async function keepTilesOf(url, response) {
  const addresses = addressesOf(url);
  const headers = new Headers({ 'content-type': 'application/octet-stream' });
  for (const [place, tile] of tilesOf(new Uint8Array(await response.arrayBuffer()), addresses.length)) {
    await keep(addresses[place], new Response(tile, { headers }));
  }
}

/** A group of the tiles that are kept; undefined if none is. The others are left out of it. @param {URL} url */
async function groupOfKept(url) {
  const bytesOf = async (address) => new Uint8Array((await (await lookUp(address))?.arrayBuffer()) ?? []);
  const tiles = await Promise.all(addressesOf(url).map(bytesOf));
  const head = [...GROUP_MAGIC].map((letter) => letter.charCodeAt(0));
  const body = [];
  let room = MAX_GROUP_BYTES;
  for (const tile of tiles) {
    const isKept = tile.length > 0 && tile.length <= room;
    for (let rest = isKept ? tile.length + 2 : 1; ; rest = Math.floor(rest / 128)) {
      head.push(rest < 128 ? rest : (rest % 128) + 128);
      if (rest < 128) break;
    }
    if (!isKept) continue;
    room -= tile.length;
    body.push(tile);
  }
  if (body.length === 0) return undefined;
  const headers = { 'content-type': 'application/octet-stream' };
  return new Response(new Blob([new Uint8Array(head), ...body]), { status: 200, headers });
}

/**
 * The tiles of a group of `count` places with their places, as `docs/formats.md` describes it; none of a damaged one.
 * @param {Uint8Array} bytes @param {number} count @returns {[number, Uint8Array][]}
 */
function tilesOf(bytes, count) {
  if (String.fromCharCode(...bytes.subarray(0, 4)) !== GROUP_MAGIC) return [];
  let at = 4;
  const varint = () => {
    for (let value = 0, factor = 1; at < bytes.length; factor *= 128) {
      const byte = bytes[at++];
      value += (byte % 128) * factor;
      if (byte < 128) return value;
    }
    return 0;
  };
  const stored = Array.from({ length: count }, varint);
  const tiles = [];
  for (const [place, number] of stored.entries()) {
    // 0: there is no such tile, 1: it is not in this group.
    if (number < 2) continue;
    const tile = bytes.subarray(at, (at += number - 2));
    if (at > bytes.length) return [];
    tiles.push([place, tile]);
  }
  return tiles;
}

/** @param {Request} request @param {boolean} isPage @param {(work: Promise<unknown>) => void} later */
async function fromNetworkFirst(request, isPage, later) {
  const key = withoutHash(request.url);
  const known = await lookUp(key);
  try {
    const late = new AbortController();
    const timer = known && setTimeout(() => late.abort(), PATIENCE_MS);
    const response = await fetch(request, known ? { signal: late.signal } : {});
    // A body may take its time.
    clearTimeout(timer);
    if (isKept(response, isPage ? PAGE_TYPE : fileType(new URL(key).pathname))) {
      later((isPage ? keepPage : keep)(key, response.clone()));
    }
    // A gateway whose server is down is no better than no network.
    return known && response.status >= 500 ? known : response;
  } catch (error) {
    if (known) return known;
    throw error;
  }
}

/**
 * A range of an archive. It is stored as a whole response, because caches refuse partial ones. The viewer asks with the version of the
 * city, so ranges of files that were replaced are not found.
 * @param {Request} request @param {(work: Promise<unknown>) => void} later
 */
async function rangeOf(request, later) {
  const file = withoutHash(request.url);
  const key = keyOf(file, RANGE_PARAMETER, request.headers.get('range') ?? '');
  const found = await lookUpUnlessReloaded(request, key);
  if (found) return new Response(found.body, { status: 206, statusText: 'Partial Content', headers: found.headers });
  const wanted = boundsOf(request);
  const part = wanted && request.cache !== 'reload' ? await partOfKept(file, wanted) : undefined;
  if (part) return part;
  const response = await fetch(request);
  if (isKept(response, RANGE_TYPE, 206)) {
    const { headers, body } = response.clone();
    later(keep(key, new Response(body, { status: 200, headers })));
    if (wanted) later(noteRange(file, wanted));
  }
  return response;
}

/** @param {string} address @param {string} name @param {string | number} value */
function keyOf(address, name, value) {
  const key = new URL(address);
  key.searchParams.set(name, String(value));
  return key.href;
}

/** The kept ranges that touch a block. @param {string} file @param {number} block @returns {Promise<[number, number][]>} */
async function rangesOf(file, block) {
  return (await (await lookUp(keyOf(file, BLOCK_PARAMETER, block)))?.json()) ?? [];
}

/** The last change of a block's ranges. They are changed one after another: of two changes at once, one would be lost. */
let noted = Promise.resolve();

/** Makes a range findable by what lies in it. @param {string} file @param {[number, number]} bounds */
function noteRange(file, [first, last]) {
  if (last - first >= BLOCK_BYTES) return noted;
  const note = async () => {
    for (let block = Math.floor(first / BLOCK_BYTES); block * BLOCK_BYTES <= last; block++) {
      const others = (await rangesOf(file, block)).filter(([begin, end]) => begin < first || end > last);
      const ranges = [[first, last], ...others].slice(0, MAX_RANGES_OF_BLOCK);
      await keep(keyOf(file, BLOCK_PARAMETER, block), new Response(JSON.stringify(ranges)));
    }
  };
  noted = noted.then(note).catch(() => undefined);
  return noted;
}

/**
 * A range whose bytes are kept as parts of others. Neighbouring tiles are read together, each time others, and one by one after a failure.
 * @param {string} file @param {[number, number]} wanted @returns {Promise<Response | undefined>}
 */
async function partOfKept(file, [first, last]) {
  if (last - first >= BLOCK_BYTES) return undefined;
  // At most two blocks are touched.
  const blocks = new Set([first, last].map((byte) => Math.floor(byte / BLOCK_BYTES)));
  const ranges = (await Promise.all([...blocks].map((block) => rangesOf(file, block)))).flat();
  const body = [];
  let headers;
  // Of the ranges that have the next byte, the one that reaches furthest; of those that are gone meanwhile, the next.
  ranges.sort((a, b) => b[1] - a[1]);
  for (let at = first; at <= last; ) {
    const index = ranges.findIndex(([begin, end]) => begin <= at && at <= end);
    if (index < 0) return undefined;
    const [[begin, end]] = ranges.splice(index, 1);
    const found = await lookUp(keyOf(file, RANGE_PARAMETER, `bytes=${begin}-${end}`));
    const bytes = found && new Uint8Array(await found.arrayBuffer());
    if (bytes?.length !== end - begin + 1) continue;
    headers ??= new Headers(found.headers);
    body.push(bytes.subarray(at - begin, last - begin + 1));
    at = end + 1;
  }
  const length = /\/(\d+)$/.exec(headers.get('content-range') ?? '')?.[1] ?? '*';
  headers.set('content-range', `bytes ${first}-${last}/${length}`);
  headers.set('content-length', String(last - first + 1));
  return new Response(new Blob(body), { status: 206, statusText: 'Partial Content', headers });
}

/** First and last byte of the range that a request asks for. @param {Request} request @returns {[number, number] | undefined} */
function boundsOf(request) {
  const match = /^bytes=(\d{1,15})-(\d{1,15})$/.exec(request.headers.get('range') ?? '');
  return match ? [Number(match[1]), Number(match[2])] : undefined;
}

/**
 * Whether a response may be kept: a whole one, or a range, of the address and the type that were asked for. Portals and wrong addresses
 * answer with other types.
 * @param {Response} response @param {RegExp} type
 */
function isKept({ status, redirected, headers }, type, expected = 200) {
  const isForbidden = redirected || /no-store/i.test(headers.get('cache-control') ?? '');
  return status === expected && !isForbidden && type.test(headers.get('content-type') ?? '');
}

/** The type of a file by the end of its path, in any of its spellings, or one of hosts that do not know it. @param {string} path */
function fileType(path) {
  return new RegExp(`^$|octet-stream|${TYPE_WORDS[/\.(\w+)$/.exec(path)?.[1]] ?? 'json'}`, 'i');
}

/** @param {string} address */
function withoutHash(address) {
  return address.split('#', 1)[0];
}

/** Keeps a page after the files that it names, so that it works without a network. @param {string} key @param {Response} response */
async function keepPage(key, response) {
  const html = await response.clone().text();
  const addresses = [...html.matchAll(ASSET_IN_PAGE)].map((match) => new URL(match[1], key).href);
  const fetchMissing = async (address) => {
    if (new URL(address).origin !== self.location.origin || (await lookUp(address))) return;
    const asset = await fetch(address);
    if (!isKept(asset, fileType(address))) throw new Error(address);
    await keep(address, asset);
  };
  await Promise.all([...new Set(addresses)].map(fetchMissing));
  await keep(key, response);
}

/** A kept response, unless the viewer found it damaged. @param {Request} request @param {string} key */
async function lookUpUnlessReloaded(request, key) {
  return request.cache === 'reload' ? undefined : lookUp(key);
}

/** A kept response; undefined if there is none, or the cache fails. What only the older cache has is kept on. @param {string} key */
async function lookUp(key) {
  const search = async () => {
    const { newer, older } = await names();
    const find = async (name) => name && (await caches.open(name)).match(key, { ignoreVary: true });
    const found = await find(newer);
    if (found) return found;
    const aged = await find(older);
    if (aged) keep(key, aged.clone());
    return aged;
  };
  const patience = new Promise((resolve) => setTimeout(resolve, LOOK_UP_MS));
  return Promise.race([search().catch(() => undefined), patience]);
}

/** Keeps a response if there is room. Never fails. @param {string} key @param {Response} response */
async function keep(key, response) {
  try {
    const body = await response.blob();
    const limit = (await limitBytes()) / 2;
    if (body.size > limit / 2) return;
    const now = await names();
    const cache = await caches.open(now.newer);
    await cache.put(key, new Response(body, { status: 200, headers: response.headers }));
    const counted = Math.floor(now.bytes / COUNT_BYTES);
    now.bytes += body.size + ENTRY_BYTES;
    if (Math.floor(now.bytes / COUNT_BYTES) > counted) await cache.put(countKey(), new Response(String(now.bytes)));
    if (now.bytes > limit) await age(now);
  } catch (error) {
    // The browser grants less than it said.
    if (error?.name === 'QuotaExceededError') await names().then(age).catch(() => undefined);
  }
}

/** Begins a new cache, and removes the older one. @param {Names} now */
async function age(now) {
  const { newer, older } = now;
  Object.assign(now, { newer: PREFIX + (numberOf(newer) + 1), older: newer, bytes: 0 });
  if (older) await caches.delete(older);
}

/** @typedef {{newer: string, older: string | undefined, bytes: number}} Names The caches, and how full the newer one is. */

/** @type {Promise<Names> | undefined} */
let known;

/** @returns {Promise<Names>} */
function names() {
  const find = async () => {
    const all = (await caches.keys()).filter((name) => name.startsWith(PREFIX)).sort((a, b) => numberOf(b) - numberOf(a));
    const [newer = `${PREFIX}1`, older, ...others] = all;
    await Promise.all(others.map((name) => caches.delete(name)));
    const count = await (await caches.open(newer)).match(countKey());
    return { newer, older, bytes: Number((await count?.text()) ?? 0) };
  };
  known ??= find().catch((error) => {
    known = undefined;
    throw error;
  });
  return known;
}

/** @param {string} name */
function numberOf(name) {
  return Number(name.slice(PREFIX.length)) || 0;
}

function countKey() {
  return `${self.location.origin}/?${COUNT_PARAMETER}`;
}

async function limitBytes() {
  const estimate = await (navigator.storage?.estimate?.() ?? Promise.resolve({}));
  return Math.min(MAX_BYTES, (estimate.quota ?? MAX_BYTES) * MAX_SHARE);
}
