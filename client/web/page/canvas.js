/** Canvases of the engine's worker that need no GPU. */

/** The canvas that shows frames of the CPU. */
export class CpuCanvas {
  /** @param {OffscreenCanvas} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d', { alpha: false });
  }

  /** Shows a frame, scaled to the canvas by the page. @param {ImageData} image */
  show(image) {
    if (this.canvas.width !== image.width || this.canvas.height !== image.height) {
      Object.assign(this.canvas, { width: image.width, height: image.height });
    }
    this.context.putImageData(image, 0, 0);
  }
}

/**
 * A PNG of a picture with lines of text in its lower left corner.
 * @param {ImageData|ImageBitmap} image
 * @param {string[]} lines
 * @returns {Promise<Blob>}
 */
export function captioned(image, lines) {
  const canvas = new OffscreenCanvas(image.width, image.height);
  const context = canvas.getContext('2d');
  if (image instanceof ImageData) context.putImageData(image, 0, 0);
  else context.drawImage(image, 0, 0);
  const size = Math.max(11, Math.round(image.height / 60));
  context.font = `${size}px system-ui, sans-serif`;
  context.textBaseline = 'bottom';
  lines.forEach((line, at) => {
    const y = image.height - size * 0.6 - (lines.length - 1 - at) * size * 1.4;
    context.lineWidth = size / 4;
    context.strokeStyle = '#000c';
    context.strokeText(line, size * 0.8, y, image.width - size * 1.6);
    context.fillStyle = '#fff';
    context.fillText(line, size * 0.8, y, image.width - size * 1.6);
  });
  return canvas.convertToBlob({ type: 'image/png' });
}
