/** Starts workers. */

/** A text, not the base of a `new URL`: bundlers would copy all files that such an address may have. */
const folder = import.meta.url.replace(/[^/]*$/, '');

/**
 * Starts a module worker of this folder. One of another origin must be imported by a script of the page's origin.
 * @param {string} name File name.
 * @param {() => Worker} start `new Worker(new URL('./NAME', import.meta.url), { type: 'module' })`, as a whole: bundlers follow it.
 * @returns {Worker}
 */
export function startWorker(name, start) {
  const url = new URL(folder + name);
  // A bundler may leave the address of a source file here; only `start` has the script's new address then.
  if (url.protocol === 'file:' || url.origin === self.origin) return start();
  const script = new Blob([`import ${JSON.stringify(url.href)};`], { type: 'text/javascript' });
  const blobUrl = URL.createObjectURL(script);
  const worker = new Worker(blobUrl, { type: 'module' });
  worker.addEventListener('message', () => URL.revokeObjectURL(blobUrl), { once: true });
  return worker;
}
