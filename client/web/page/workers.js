/** Starts workers. */

/** A text, not the base of a `new URL`: bundlers would copy all files that such an address may have. */
export const folder = import.meta.url.replace(/[^/]*$/, '');

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
 * @param {() => Worker} start `new Worker(new URL('./NAME', import.meta.url), { type: 'module' })`, as a whole: bundlers follow it.
 * @returns {Worker}
 */
export function startWorker(name, start) {
  const url = new URL(folder + name);
  // A bundler may leave the address of a source file here; only `start` has the script's new address then.
  if (url.protocol === 'file:' || url.origin === self.origin) {
    return globalThis.trustedTypes ? withPolicy(start) : start();
  }
  const script = new Blob([`import ${JSON.stringify(url.href)};`], { type: 'text/javascript' });
  const blobUrl = URL.createObjectURL(script);
  const worker = new Worker(policy.createScriptURL(blobUrl), { type: 'module' });
  worker.addEventListener('message', () => URL.revokeObjectURL(blobUrl), { once: true });
  return worker;
}

/**
 * Starts a worker with an address of the policy. `start` cannot ask for it: bundlers follow only calls of `Worker` with the address itself.
 * @param {() => Worker} start
 * @returns {Worker}
 */
function withPolicy(start) {
  const { Worker: original } = globalThis;
  const construct = (_, [url, options]) => new original(policy.createScriptURL(String(url)), options);
  globalThis.Worker = new Proxy(original, { construct });
  try {
    return start();
  } finally {
    globalThis.Worker = original;
  }
}
