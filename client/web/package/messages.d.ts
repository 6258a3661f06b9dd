/** Messages between the element and its engine. Made from client/web/host/src by a test. */

/**
 * How a viewer begins.
 */
export type ViewerOptions = { 
/**
 * The text of the manifest, which the page has fetched.
 */
manifest: string, 
/**
 * `http://host` of a server, or the URL of a baked city's folder.
 */
base: string, isFolder: boolean, 
/**
 * Appended to each address of a server: a share link, or empty.
 */
query: string, width: number, height: number, cacheBytes: number, tau: number | null, camera: string | null, time: string | null, };

/**
 * A command without an answer.
 */
export type Command = { "resize": { width: number, height: number, } } | { "move": { direction: Direction, held: boolean, } } | { "fast": { held: boolean, } } | { "release": Record<symbol, never> } | { "drag": { dx: number, dy: number, } } | { "pan": { dx: number, dy: number, } } | { "zoom": { factor: number, } } | { "wheel": { steps: number, } } | { "turn": { rad: number, } } | { "tilt": { rad: number, } } | { "approach": { x: number, y: number, } } | { "mode": { mode: Mode, } } | { "north": Record<symbol, never> } | { "home": Record<symbol, never> } | { "collision": { on: boolean, } } | { "camera": { camera: string, seconds: number | null, } } | { "goto": { position: [number, number, number], seconds: number | null, } } | { "time": { time: string, } } | { "day": { running: boolean, } } | { "options": OptionsCommand } | { "markers": { points: Array<[number, number, number]>, } } | { "lines": { lines: Array<Array<[number, number, number]>>, } } | { "measure": MeasureCommand };

/**
 * Options that change.
 */
export type OptionsCommand = { tau: number | null, fps: number | null, distances: string | null, shadows: boolean | null, shading: number | null, look: number | null, };

/**
 * What the measuring tool does.
 */
export type MeasureCommand = { "start": Record<symbol, never> } | { "stop": Record<symbol, never> } | { "kind": { kind: Kind, } } | { "click": { x: number, y: number, } } | { "undo": Record<symbol, never> } | { "clear": Record<symbol, never> };

export type Direction = "forward" | "back" | "left" | "right" | "up" | "down";

export type Mode = "orbit" | "fly" | "walk";

export type Kind = "line" | "area" | "height";

/**
 * How objects are coloured and filtered. What is left out asks for nothing.
 */
export type ColorRules = { 
/**
 * An attribute, `height` or `kind`.
 */
attribute: string, palette: string, 
/**
 * Values of the ends of the palette, if they are not those of the city. Dates are days since 1970-01-01.
 */
range: [number, number] | null, 
/**
 * Objects that pass, as in `yearOfConstruction < 1900 && height > 20`.
 */
filter: string, others: Others, 
/**
 * Objects with larger values of the attribute are hidden.
 */
upTo: number | null, };

/**
 * How objects are drawn that do not pass a filter: pale, not at all, or as they are.
 */
export type Others = "ghost" | "hide" | "keep";

/**
 * What is over the picture that is on the screen. Places are pixels of the frame, from the upper left corner.
 */
export type FrameMessage = { op: string, 
/**
 * `X,Y,Z,AZIMUTH,PITCH,FOV` in metres and degrees.
 */
camera: string, position: [number, number, number], 
/**
 * Degrees clockwise from the grid's north.
 */
azimuth: number, 
/**
 * Degrees above the horizon.
 */
pitch: number, mode: string, 
/**
 * Whether ground and buildings stop the camera.
 */
collides: boolean, 
/**
 * Solar time, `YYYY-MM-DDThh:mm`.
 */
time: string, 
/**
 * At the surface in the middle of the view; `null` if there is none.
 */
metersPerPixel: number | null, 
/**
 * Place of each marker, and whether nothing hides it.
 */
markers: Array<[number, number, boolean]>, 
/**
 * The same of points along each line.
 */
lines: Array<Array<[number, number, boolean]>>, measure: MeasureMessage | null, 
/**
 * Edges of the boxes of nodes, with a shading that asks for them: x, y, x, y.
 */
boxes: Array<[number, number, number, number]>, 
/**
 * Tiles that the frame lacks.
 */
missing: number, 
/**
 * Whether nothing can improve the frame.
 */
isSettled: boolean, 
/**
 * Tiles that arrived so far.
 */
tiles: number, };

/**
 * The measured figure.
 */
export type MeasureMessage = { kind: string, 
/**
 * The result as lengths and areas with their units, such as `13.00 m`; none before there is one.
 */
figures: Array<string>, points: Array<[number, number]>, 
/**
 * Ends of each line: x, y, x, y.
 */
lines: Array<[number, number, number, number]>, closed: boolean, };

/**
 * What is known of an object. Texts are of the city's source: show them as text.
 */
export type ObjectMessage = { id: number, identifier: string, 
/**
 * Identifier of its parent.
 */
parent: string | null, kind: string, 
/**
 * By name, in the order in which they are shown. What the object lacks is from its parent. Dates are texts.
 */
attributes: Record<string, string | number | boolean>, 
/**
 * World coordinates of the middle of its box, or of its parts' if it has no shape.
 */
centre: [number, number, number] | null, 
/**
 * Parts of an object without a shape.
 */
parts: Array<number>, };

/**
 * What objects of a city have.
 */
export type SchemaMessage = { 
/**
 * Number of objects.
 */
objects: number, 
/**
 * Names of attributes by which objects can be coloured.
 */
colorBy: Array<string>, palettes: Array<string>, 
/**
 * The attributes as the schema of the city has them.
 */
attributes: import('./insula-viewer.js').Attribute[], 
/**
 * What people read, by the name of the attribute.
 */
labels: Record<string, import('./insula-viewer.js').AttributeLabel>, };

/**
 * The colours of objects.
 */
export type ColorsMessage = { 
/**
 * What explains the colours; `null` without an attribute.
 */
legend: import('./insula-viewer.js').Legend | null, 
/**
 * Number of objects that pass the filter.
 */
passing: number, };

/**
 * The state of streaming.
 */
export type StatusMessage = { op: string, 
/**
 * `loading`, `offline`, `error`; `null` if all is well.
 */
kind: string | null, text: string, };

/**
 * What the engine does next.
 */
export type Step = { 
/**
 * `rows` of a frame on the CPU, a frame on the `gpu`, or `none`.
 */
action: string, 
/**
 * How long to wait for an arrival or a command before the next update.
 */
waitMs: number, width: number, height: number, 
/**
 * The rows to draw.
 */
first: number, end: number, 
/**
 * Whether the frame must be sent to the workers.
 */
isNew: boolean, 
/**
 * Whether writes to the atlas must be sent to the workers.
 */
hasWrites: boolean, 
/**
 * Whether the frame is the picture that was asked for.
 */
isPicture: boolean, divisor: number, samples: number, isFinal: boolean, };

