/**
 * One budget of memory for the tiles of all viewers of a page, however many there are and however many workers each has: every worker
 * that draws has a copy of the tiles. A viewer that joins takes its share from the others.
 */

/** Viewers are told of their new shares together, when no other joined for this time. */
const SETTLE_MS = 200;
/** Less shows no city. */
const MIN_WORKER_MIB = 12;
const MAX_WORKERS = 4;

/**
 * The memory of one viewer.
 * @typedef {object} MemoryShare
 * @property {number} workers Number of workers that draw.
 * @property {number} cacheMib Tiles of each worker.
 * @property {number} gpuMib Tiles on a graphics adapter.
 */

/** Running viewers, and how many there were when they got their share. @type {Map<object, {count: number, resize: (share: MemoryShare) => void}>} */
const viewers = new Map();
let timer = 0;

/**
 * Memory for tiles of the whole page in MiB. Some browsers, and all on plain http, do not tell the device's memory: then phones count
 * as 4 GiB.
 * @returns {number}
 */
function budgetMib() {
  const isPhone = matchMedia('(pointer: coarse)').matches;
  const gib = navigator.deviceMemory ?? (isPhone ? 4 : 8);
  if (gib <= 1) return 32;
  if (gib <= 2) return 64;
  return gib <= 4 ? 128 : 192;
}

/** The share of one of `count` viewers. @param {number} count @returns {MemoryShare} */
function shareOf(count) {
  const gpuMib = budgetMib() / count;
  // The viewer waits while its workers draw, so only the page needs a core of its own.
  const cores = navigator.hardwareConcurrency ?? 2;
  const mostWorkers = Math.min(cores > 2 ? cores - 1 : cores, MAX_WORKERS, Math.floor(gpuMib / MIN_WORKER_MIB));
  const workers = Math.max(Math.min(mostWorkers, Math.ceil(MAX_WORKERS / count)), 1);
  return { workers, cacheMib: gpuMib / workers, gpuMib };
}

/**
 * Takes a share for a viewer that starts. Viewers that the page will start soon are counted.
 * @param {object} viewer
 * @param {(share: MemoryShare) => void} resize Called when the viewer must give memory to others.
 * @returns {MemoryShare}
 */
export function takeMemory(viewer, resize) {
  viewers.delete(viewer);
  const count = Math.max(viewers.size + 1, document.querySelectorAll('insula-city[src]').length);
  viewers.set(viewer, { count, resize });
  clearTimeout(timer);
  timer = setTimeout(shrink, SETTLE_MS);
  return shareOf(count);
}

/** Gives back what a viewer has taken. @param {object} viewer */
export function returnMemory(viewer) {
  viewers.delete(viewer);
}

function shrink() {
  for (const viewer of viewers.values()) {
    if (viewer.count >= viewers.size) continue;
    viewer.count = viewers.size;
    viewer.resize(shareOf(viewer.count));
  }
}
