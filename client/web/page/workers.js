/** Starts workers. */

/**
 * Starts a module worker of this folder. One of another origin must be imported by a script of the page's origin.
 * @param {string} name File name.
 * @returns {Worker}
 */
export function startWorker(name) {
  const url = new URL(`./${name}`, import.meta.url);
  if (url.origin === self.origin) return new Worker(url, { type: 'module' });
  const script = new Blob([`import ${JSON.stringify(url.href)};`], { type: 'text/javascript' });
  const blobUrl = URL.createObjectURL(script);
  const worker = new Worker(blobUrl, { type: 'module' });
  worker.addEventListener('message', () => URL.revokeObjectURL(blobUrl), { once: true });
  return worker;
}
