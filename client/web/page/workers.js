/** Starts workers. */

/** Kept apart from `new URL`: bundlers take an address of both for a file to copy. */
const here = import.meta.url;

/**
 * Starts a module worker of this folder. One of another origin must be imported by a script of the page's origin.
 * @param {string} name File name.
 * @param {() => Worker} start `new Worker(new URL('./NAME', import.meta.url), { type: 'module' })`, as a whole: so bundlers find the script.
 * @returns {Worker}
 */
export function startWorker(name, start) {
  const url = new URL(`./${name}`, here);
  // A bundler may leave the address of a source file here; only `start` has the script's new address then.
  if (url.protocol === 'file:' || url.origin === self.origin) return start();
  const script = new Blob([`import ${JSON.stringify(url.href)};`], { type: 'text/javascript' });
  const blobUrl = URL.createObjectURL(script);
  const worker = new Worker(blobUrl, { type: 'module' });
  worker.addEventListener('message', () => URL.revokeObjectURL(blobUrl), { once: true });
  return worker;
}
