/** Watches whether an element is visible, and how many device pixels it has. */

/** Watches until it is disposed of. */
export class ViewWatch {
  /** Size in device pixels. */
  width = 1;
  height = 1;
  /** Device pixels per CSS pixel. */
  ratio = 1;
  #host;
  #actions;
  #stop = new AbortController();
  #resize = new ResizeObserver((entries) => this.#resized(entries.at(-1)));
  #intersection = new IntersectionObserver((entries) => this.#intersected(entries.at(-1)));
  #isInView = true;
  #isVisible = true;

  /**
   * @param {HTMLElement} host
   * @param {{resize: () => void, visible: (visible: boolean) => void}} actions
   */
  constructor(host, actions) {
    this.#host = host;
    this.#actions = actions;
    this.#setSize(host.clientWidth * devicePixelRatio, host.clientHeight * devicePixelRatio);
    try {
      this.#resize.observe(host, { box: 'device-pixel-content-box' });
    } catch {
      // Browsers without this box report no change of the pixel ratio alone.
      this.#resize.observe(host);
      window.addEventListener('resize', () => this.#resized(), { signal: this.#stop.signal });
    }
    this.#intersection.observe(host);
    document.addEventListener('visibilitychange', () => this.#update(), { signal: this.#stop.signal });
  }

  /** Stops watching. */
  dispose() {
    this.#resize.disconnect();
    this.#intersection.disconnect();
    this.#stop.abort();
  }

  #resized(entry) {
    const box = entry?.devicePixelContentBoxSize?.[0];
    const before = [this.width, this.height].join();
    const { clientWidth, clientHeight } = this.#host;
    this.#setSize(box?.inlineSize ?? clientWidth * devicePixelRatio, box?.blockSize ?? clientHeight * devicePixelRatio);
    if (before !== [this.width, this.height].join()) this.#actions.resize();
  }

  #setSize(width, height) {
    this.width = Math.max(Math.round(width), 1);
    this.height = Math.max(Math.round(height), 1);
    this.ratio = this.width / Math.max(this.#host.clientWidth, 1);
  }

  #intersected(entry) {
    this.#isInView = entry?.isIntersecting ?? this.#isInView;
    this.#update();
  }

  #update() {
    const isVisible = this.#isInView && document.visibilityState !== 'hidden';
    if (isVisible === this.#isVisible) return;
    this.#isVisible = isVisible;
    this.#actions.visible(isVisible);
  }
}
