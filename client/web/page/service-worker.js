/**
 * Keeps visited pages, the viewer's files and tiles for use without a network.
 *
 * Addresses that never change are answered from the cache first; pages and manifests from the network first. The cache is bounded:
 * beyond its limit, what was used longest ago is removed. Only GET requests to this host are looked at.
 */

const CACHE_NAME = 'insula-1';
const DATABASE = 'insula-cache';
const STORE = 'entries';
const MAX_BYTES = 256 * 2 ** 20;
/** Share of the space that the browser grants this host. */
const MAX_SHARE = 0.3;
/** After a removal the cache is this full, so that not every new entry causes one. */
const KEPT_SHARE = 0.9;
/** Pages and the viewer's files outlive tiles that were used as much later: without them, no tile is of use. */
const PAGE_BONUS_MS = 30 * 24 * 3_600_000;
/** An entry that is used again within this time is not marked again. */
const MARK_MS = 60_000;
/** A page that is in the cache waits this long for the network. */
const PATIENCE_MS = 4_000;
/** Stands for the range of a request in the cache's keys: the cache cannot hold partial responses. */
const RANGE_PARAMETER = 'insula-range';

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
const ASSET_IN_PAGE = /(?:href|src)="([^"]*assets\/[0-9a-f]{16}\/[^"]+)"/g;

self.addEventListener('install', (event) => event.waitUntil(self.skipWaiting()));
self.addEventListener('activate', (event) => event.waitUntil(start()));
self.addEventListener('fetch', (event) => {
  const answer = answerTo(event.request, event);
  if (answer) event.respondWith(answer);
});

/** Removes the caches of older versions, and keeps the pages that are open: they were loaded before this script ran. */
async function start() {
  const names = await caches.keys();
  const old = names.filter((name) => name.startsWith('insula-') && name !== CACHE_NAME);
  await Promise.all(old.map((name) => caches.delete(name)));
  await self.clients.claim();
  const pages = await self.clients.matchAll({ type: 'window', includeUncontrolled: true });
  await Promise.all(pages.map((page) => fromNetworkFirst(new Request(page.url), true).catch(() => null)));
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
  const later = (work) => event.waitUntil(work.catch(() => undefined));
  if (request.headers.has('range')) {
    return ARCHIVE.test(url.pathname) ? rangeOf(request, later) : null;
  }
  if (ASSET.test(url.pathname) || TILE.test(url.pathname)) return fromCacheFirst(request, later);
  if (GROUP.test(url.pathname)) return groupOf(request, later);
  const isPage = request.mode === 'navigate';
  if (isPage || MANIFEST.test(url.pathname) || PAGE_FILE.test(url.pathname)) return fromNetworkFirst(request, isPage);
  return null;
}

/** @param {Request} request @param {(work: Promise<unknown>) => void} later */
async function fromCacheFirst(request, later) {
  const found = await lookUpUnlessReloaded(request, request.url);
  if (found) return found;
  const response = await fetch(request);
  if (response.status === 200) later(keep(request.url, response.clone()));
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
    if (response.status === 200) later(keepTilesOf(url, response.clone()));
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

/** @param {Request} request @param {boolean} isPage */
async function fromNetworkFirst(request, isPage) {
  const key = withoutHash(request.url);
  const known = await lookUp(key);
  try {
    const options = known ? { signal: AbortSignal.timeout(PATIENCE_MS) } : {};
    const response = await fetch(request, options);
    if (response.status === 200 && !isUnkept(response)) {
      await forgetReplacedArchives(key, known, response.clone());
      if (isPage) await keepAssets(key, await response.clone().text());
      await keep(key, response.clone());
    }
    // A gateway whose server is down is no better than no network.
    return known && response.status >= 500 ? known : response;
  } catch (error) {
    if (known) return known;
    throw error;
  }
}

/**
 * A range of an archive. It is stored as a whole response, because caches refuse partial ones.
 * @param {Request} request @param {(work: Promise<unknown>) => void} later
 */
async function rangeOf(request, later) {
  const key = new URL(withoutHash(request.url));
  key.searchParams.set(RANGE_PARAMETER, request.headers.get('range') ?? '');
  const found = await lookUpUnlessReloaded(request, key.href);
  if (found) return new Response(found.body, { status: 206, statusText: 'Partial Content', headers: found.headers });
  const part = request.cache === 'reload' ? undefined : await partOfKept(key);
  if (part) return part;
  const response = await fetch(request);
  if (response.status === 206) {
    const { headers, body } = response.clone();
    later(keep(key.href, new Response(body, { status: 200, headers })));
  }
  return response;
}

/**
 * A range that lies in a longer one that is kept: neighbouring tiles are read together, and one by one after a failure.
 * @param {URL} key @returns {Promise<Response | undefined>}
 */
async function partOfKept(key) {
  const wanted = boundsOf(key);
  if (!wanted) return undefined;
  const [first, last] = wanted;
  const folder = key.href.split('?', 1)[0] + '?';
  for (const entry of (await entries).all()) {
    const kept = entry.key.startsWith(folder) ? boundsOf(new URL(entry.key)) : undefined;
    if (!kept || kept[0] > first || kept[1] < last) continue;
    const found = await lookUp(entry.key);
    const bytes = found && new Uint8Array(await found.arrayBuffer()).slice(first - kept[0], last - kept[0] + 1);
    if (!bytes || bytes.length !== last - first + 1) continue;
    const headers = new Headers(found.headers);
    const length = /\/(\d+)$/.exec(headers.get('content-range') ?? '')?.[1] ?? '*';
    headers.set('content-range', `bytes ${first}-${last}/${length}`);
    headers.set('content-length', String(bytes.length));
    return new Response(bytes, { status: 206, statusText: 'Partial Content', headers });
  }
  return undefined;
}

/** First and last byte of the range that a key of the cache names. @param {URL} key @returns {[number, number] | undefined} */
function boundsOf(key) {
  const match = /^bytes=(\d{1,15})-(\d{1,15})$/.exec(key.searchParams.get(RANGE_PARAMETER) ?? '');
  return match ? [Number(match[1]), Number(match[2])] : undefined;
}

/** Whether the host forbids to keep a response. @param {Response} response */
function isUnkept(response) {
  return /no-store/.test(response.headers.get('cache-control') ?? '') || response.redirected;
}

/** @param {string} address */
function withoutHash(address) {
  return address.split('#', 1)[0];
}

/**
 * Removes the ranges of a city's archives once its manifest has changed: they are of the old files.
 * @param {string} key @param {Response | undefined} known @param {Response} response
 */
async function forgetReplacedArchives(key, known, response) {
  if (!known || !key.split('?', 1)[0].endsWith('/city.json')) return;
  if ((await known.clone().text()) === (await response.text())) return;
  const folder = key.slice(0, key.lastIndexOf('city.json'));
  const index = await entries;
  await index.remove(index.all().filter((entry) => entry.key.startsWith(folder) && entry.key.includes('.pmtiles?')));
}

/** Keeps the files that a page names, so that the page works without a network. @param {string} page @param {string} html */
async function keepAssets(page, html) {
  const addresses = [...html.matchAll(ASSET_IN_PAGE)].map((match) => new URL(match[1], page).href);
  const fetchMissing = async (address) => {
    if (new URL(address).origin !== self.location.origin || (await lookUp(address))) return;
    const response = await fetch(address);
    if (response.status === 200) await keep(address, response);
  };
  await Promise.all([...new Set(addresses)].map(fetchMissing));
}

/** A kept response, unless the viewer found it damaged. @param {Request} request @param {string} key */
async function lookUpUnlessReloaded(request, key) {
  return request.cache === 'reload' ? undefined : lookUp(key);
}

/** A kept response, which is marked as used. @param {string} key */
async function lookUp(key) {
  const cache = await caches.open(CACHE_NAME);
  const found = await cache.match(key, { ignoreVary: true });
  if (found) entries.then((index) => index.mark(key)).catch(() => undefined);
  return found;
}

/** Keeps a response, and removes others if there are too many bytes. @param {string} key @param {Response} response */
async function keep(key, response) {
  const body = await response.blob();
  const limit = await limitBytes();
  if (body.size > limit / 4) return;
  const cache = await caches.open(CACHE_NAME);
  const index = await entries;
  try {
    await cache.put(key, new Response(body, { status: 200, headers: response.headers }));
  } catch (error) {
    // The browser grants less than it said.
    await index.shrink(index.bytes / 2);
    throw error;
  }
  await index.add(key, body.size);
  if (index.bytes > limit) await index.shrink(limit * KEPT_SHARE);
}

async function limitBytes() {
  const estimate = await (navigator.storage?.estimate?.() ?? Promise.resolve({}));
  return Math.min(MAX_BYTES, (estimate.quota ?? MAX_BYTES) * MAX_SHARE);
}

/** The sizes of all entries and when they were used. A copy in a database outlives this script, which the browser often stops. */
class EntryIndex {
  /** @param {IDBDatabase} database @param {{key: string, bytes: number, used: number}[]} list */
  constructor(database, list) {
    this.database = database;
    this.byKey = new Map(list.map((entry) => [entry.key, entry]));
    this.bytes = list.reduce((sum, entry) => sum + entry.bytes, 0);
  }

  static async open() {
    const opening = indexedDB.open(DATABASE, 1);
    opening.onupgradeneeded = () => opening.result.createObjectStore(STORE, { keyPath: 'key' });
    const database = await settled(opening);
    const index = new EntryIndex(database, await settled(database.transaction(STORE).objectStore(STORE).getAll()));
    await index.adopt();
    return index;
  }

  /** Makes index and cache agree: the browser may have stopped this script between the two. */
  async adopt() {
    const cache = await caches.open(CACHE_NAME);
    const kept = new Set((await cache.keys()).map((request) => request.url));
    await this.remove(this.all().filter((entry) => !kept.has(entry.key)));
    await Promise.all([...kept].filter((key) => !this.byKey.has(key)).map((key) => cache.delete(key)));
  }

  all() {
    return [...this.byKey.values()];
  }

  /** @param {string} key @param {number} bytes */
  async add(key, bytes) {
    this.bytes += bytes - (this.byKey.get(key)?.bytes ?? 0);
    await this.put({ key, bytes, used: Date.now() });
  }

  /** @param {string} key */
  async mark(key) {
    const entry = this.byKey.get(key);
    if (entry && Date.now() - entry.used > MARK_MS) await this.put({ ...entry, used: Date.now() });
  }

  async put(entry) {
    this.byKey.set(entry.key, entry);
    await settled(this.database.transaction(STORE, 'readwrite').objectStore(STORE).put(entry));
  }

  /** Removes what was used longest ago, until at most `bytes` are left. @param {number} bytes */
  async shrink(bytes) {
    const isOfCity = ({ pathname }) => TILE.test(pathname) || ARCHIVE.test(pathname);
    const rank = ({ key, used }) => used + (isOfCity(new URL(key)) ? 0 : PAGE_BONUS_MS);
    const oldestFirst = this.all().sort((a, b) => rank(a) - rank(b));
    const removed = [];
    for (let rest = this.bytes; rest > bytes && oldestFirst.length > 0; rest -= removed.at(-1).bytes) {
      removed.push(oldestFirst.shift());
    }
    await this.remove(removed);
  }

  async remove(list) {
    if (list.length === 0) return;
    const cache = await caches.open(CACHE_NAME);
    const store = this.database.transaction(STORE, 'readwrite').objectStore(STORE);
    for (const entry of list) {
      if (this.byKey.delete(entry.key)) this.bytes -= entry.bytes;
      store.delete(entry.key);
    }
    await Promise.all(list.map((entry) => cache.delete(entry.key)));
  }
}

/** @param {IDBRequest} request */
function settled(request) {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
  });
}

/** @type {Promise<EntryIndex>} */
const entries = EntryIndex.open();
