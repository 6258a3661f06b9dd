/**
 * One budget of memory for the tiles of all viewers of a page, however many there are and however many workers each has: every worker
 * that draws has a copy of the tiles. Graphics adapters have a budget of their own. A viewer that joins takes its share from the others.
 */

/** Viewers are told of their new shares together, when no other joined for this time. */
const SETTLE_MS = 200;
/** A view of a whole screen needs about this; more workers would each see less. */
const MIN_WORKER_MIB = 40;
/** Of graphics adapters, in budgets of the page. */
const GPU_BUDGETS = 2.5;
const MAX_WORKERS = 4;

/**
 * The memory of one viewer.
 * @typedef {object} MemoryShare
 * @property {number} workers Number of workers that draw.
 * @property {number} cacheMib Tiles of each worker.
 * @property {number} gpuMib Tiles on a graphics adapter.
 */

/**
 * Running viewers: their workers, and how many viewers there were when they got their share.
 * @type {Map<object, {count: number, workers: number, resize: (share: MemoryShare) => void}>}
 */
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
  return gib <= 4 ? 80 : 96;
}

/** The number of drawing workers of one of `count` viewers. @param {number} count @returns {number} */
function workersOf(count) {
  // The viewer waits while its workers draw, so only the page needs a core of its own.
  const cores = navigator.hardwareConcurrency ?? 2;
  const most = Math.min(cores > 2 ? cores - 1 : cores, MAX_WORKERS, Math.floor(budgetMib() / count / MIN_WORKER_MIB));
  return Math.max(most, 1);
}

/** The share of one of `count` viewers, if it has so many workers. @param {number} count @param {number} workers @returns {MemoryShare} */
function shareOf(count, workers) {
  const shareMib = budgetMib() / count;
  return { workers, cacheMib: Math.floor(shareMib / workers), gpuMib: Math.floor(GPU_BUDGETS * shareMib) };
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
  const workers = workersOf(count);
  viewers.set(viewer, { count, workers, resize });
  clearTimeout(timer);
  timer = setTimeout(shrink, SETTLE_MS);
  return shareOf(count, workers);
}

/** Gives back what a viewer has taken. @param {object} viewer */
export function returnMemory(viewer) {
  viewers.delete(viewer);
}

function shrink() {
  for (const viewer of viewers.values()) {
    if (viewer.count >= viewers.size) continue;
    viewer.count = viewers.size;
    viewer.resize(shareOf(viewer.count, viewer.workers));
  }
}
