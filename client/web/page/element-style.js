/** Style of the shadow root of <insula-city>. */

const CSS = `
:host {
  display: block; position: relative; overflow: hidden; contain: layout paint;
  min-block-size: 8rem; touch-action: none; user-select: none; -webkit-user-select: none;
  background: linear-gradient(#a9c4de, #dfe7ec 55%, #b9beb8);
  font: 0.875rem/1.4 system-ui, sans-serif;
}
:host([hidden]) { display: none; }
:host(:focus-visible) { outline: 3px solid var(--insula-focus, #0b66d6); outline-offset: -3px; }
.surface, canvas, .figures, .markers { position: absolute; inset: 0; inline-size: 100%; block-size: 100%; }
.surface { cursor: grab; touch-action: none; }
:host([gestures="cooperative"]:not(:focus-within)), :host([gestures="cooperative"]:not(:focus-within)) .surface { touch-action: pan-x pan-y; }
.surface:active { cursor: grabbing; }
.surface.measuring { cursor: crosshair; }
canvas { display: block; visibility: hidden; }
.surface[data-adapter="cpu"] .cpu, .surface[data-adapter="gpu"] .gpu { visibility: visible; }
.figures, .markers { pointer-events: none; overflow: hidden; }
.figures path { fill: none; stroke-linejoin: round; stroke-linecap: round; }
.measure path { stroke: #fff; stroke-width: 2.5; }
.measure path.outline { stroke: rgb(0 0 0 / 65%); stroke-width: 5.5; }
.measure circle { fill: #fff; stroke: rgb(0 0 0 / 75%); stroke-width: 1.5; }
.marker, .measure-text { position: absolute; left: 0; top: 0; inline-size: max-content; will-change: transform; }
.marker > * { display: block; pointer-events: auto; translate: -50% -100%; }
.marker[hidden], .measure-text[hidden], .status[hidden], .attribution[hidden], .gesture[hidden] { display: none; }
.marker > slot { pointer-events: none; }
::slotted(*) { pointer-events: auto; }
.label, .measure-text, .status, .attribution, .gesture { color: #f3f5f7; background: rgb(20 24 29 / 88%); border-radius: 6px; }
.label { padding: 0.2rem 0.5rem; max-inline-size: 16rem; margin-block-end: 6px; }
.measure-text { padding: 0.15rem 0.5rem; margin: 12px; font-variant-numeric: tabular-nums; pointer-events: none; }
.aim { position: absolute; left: 50%; top: 50%; inline-size: 25px; block-size: 25px; translate: -50% -50%;
  pointer-events: none; visibility: hidden; }
.aim path { stroke: #fff; stroke-width: 1.5; fill: none; }
.aim path:first-child { stroke: rgb(0 0 0 / 70%); stroke-width: 4; }
:host(:focus-visible) .measuring ~ .aim { visibility: visible; }
.status { position: absolute; inset-block-start: 0.75rem; inset-inline: 0.75rem; margin-inline: auto;
  inline-size: fit-content; padding: 0.35rem 0.75rem; pointer-events: none; }
.status:is([data-kind="error"], [data-kind="offline"], [data-kind="waiting"]) { color: #ffd08a; }
.gesture { position: absolute; inset-block-start: 50%; inset-inline: 1rem; margin-inline: auto; inline-size: fit-content; translate: 0 -50%;
  padding: 0.5rem 1rem; font-size: 1rem; pointer-events: none; text-align: center; }
.attribution { position: absolute; inset-block-end: 0.35rem; inset-inline-end: 0.35rem; padding: 0.1rem 0.45rem;
  font-size: 0.75rem; max-inline-size: calc(100% - 1.6rem); max-block-size: 3.2em; overflow: auto; user-select: text; }
.attribution a { color: inherit; }
.attribution a:focus-visible { outline: 2px solid currentColor; outline-offset: 1px; }
`;

/** @type {CSSStyleSheet|null} */
let sheet = null;

/**
 * Applies the style to a shadow root. A constructed sheet needs no exception in a Content-Security-Policy.
 * @param {ShadowRoot} root
 */
export function applyStyle(root) {
  if (!sheet) {
    sheet = new CSSStyleSheet();
    sheet.replaceSync(CSS);
  }
  root.adoptedStyleSheets = [sheet];
}
