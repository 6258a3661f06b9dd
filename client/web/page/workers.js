/** Starts workers. */

/**
 * Makes an address of a script acceptable where a page demands Trusted Types. Only this file passes addresses to it, and all are of the
 * viewer itself.
 * @type {{createScriptURL: (url: string) => any}}
 */
const policy = globalThis.trustedTypes?.createPolicy('insula', { createScriptURL: (url) => url }) ?? { createScriptURL: (url) => url };

/**
 * Registers the worker that keeps visited cities for offline use. Without it, the page works online. Browsers offer it only on https and
 * localhost.
 * @param {string} path
 */
export function registerServiceWorker(path) {
  // A sandboxed frame has no origin that could keep anything.
  if (self.origin === 'null' || !('serviceWorker' in navigator)) return;
  navigator.serviceWorker.register(policy.createScriptURL(path), { updateViaCache: 'none' }).catch(() => {});
}

/**
 * Starts a module worker of this folder. One of another origin must be imported by a script of the page's origin.
 * @param {string} name File name.
 * @returns {Worker}
 */
export function startWorker(name) {
  const url = new URL(`./${name}`, import.meta.url);
  if (url.origin === self.origin) return new Worker(policy.createScriptURL(url.href), { type: 'module' });
  const script = new Blob([`import ${JSON.stringify(url.href)};`], { type: 'text/javascript' });
  const blobUrl = URL.createObjectURL(script);
  const worker = new Worker(policy.createScriptURL(blobUrl), { type: 'module' });
  worker.addEventListener('message', () => URL.revokeObjectURL(blobUrl), { once: true });
  return worker;
}
