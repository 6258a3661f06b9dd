/** Types of the custom element <insula-city>. */

/** World coordinates in the city's system: metres to the east, to the north, and up. */
export type Position = [x: number, y: number, z: number];

/**
 * A camera: `X,Y,Z,AZIMUTH,PITCH,FOV` in metres and degrees, as in `insula://` links. The azimuth is clockwise from the grid's
 * north, the pitch is positive upwards, and the field of view is vertical.
 */
export type CameraText = string;

/** A place on Earth in degrees (WGS84), with a height in metres of the city's system, as `manifest.ground_z_m` has it. */
export interface LonLat {
  lon: number;
  lat: number;
  height: number;
}

/** A place as arguments have it. Without a height, the height of the city's ground plane. */
export type Place = { lon: number; lat: number; height?: number } | [lon: number, lat: number, height?: number];

/**
 * A camera on Earth. The heading is clockwise from true north, the pitch positive upwards (-90 to 90), and the field of view vertical
 * (1 to 170), all in degrees.
 */
export interface EarthCamera extends LonLat {
  heading: number;
  pitch: number;
  fov: number;
}

/** Degrees: west, south, east and north. */
export type Bounds =
  | [west: number, south: number, east: number, north: number]
  | [southWest: [number, number], northEast: [number, number]];

/** How an object is drawn whatever `setColors` asks for. What is left out stays as it is. */
export interface FeatureState {
  /** Any colour of CSS; `null` for that of the city. Transparency is ignored. */
  color?: string | null;
  /** Whether the object is not drawn. */
  hidden?: boolean;
}

/** How a figure of GeoJSON is drawn. */
export interface FigureStyle {
  /** Of lines, outlines and points: any colour of CSS. */
  color?: string;
  /** Of lines and outlines, in CSS pixels, 0 to 100. */
  width?: number;
  /** Of polygons: any colour of CSS, transparent ones as well. */
  fill?: string;
  /** Of points, in CSS pixels, 0 to 100. */
  radius?: number;
  hidden?: boolean;
}

/** A model and where it stands. */
export interface ModelValues {
  /** Address of a glTF file in one piece (`.glb`), at most 64 MiB. */
  url?: string;
  /** Such a file, instead of its address. */
  bytes?: ArrayBuffer | ArrayBufferView;
  /** Where the origin of the model is, in degrees. */
  lon: number;
  lat: number;
  /** Metres of the city's system. Without it, the model stands on the city, as finely as that is loaded. */
  height?: number;
  /** Degrees clockwise, by which the model is turned. With 0, its z points south. */
  heading?: number;
  /** By which its size is multiplied; 1 for a model in metres. */
  scale?: number;
}

/** What `addGeoJson` has added. */
export interface GeoJsonLayer {
  /** Of the features that are drawn; `null` for those without. */
  ids: (string | number | null)[];
  /** Features that are not drawn, by their place in the collection. */
  skipped: { index: number; reason: string }[];
  /** Changes the style of the features of an id; `null` gives them their own. */
  setState(id: string | number | null, state: FigureStyle | null): void;
  remove(): void;
}

/** Solar time `YYYY-MM-DDThh:mm`, or a time with an offset from UTC such as `2024-06-21T17:00+09:00`. */
export type TimeText = string;

export type Shading = 'lit' | 'albedo' | 'ao' | 'normal' | 'lod' | 'kind' | 'wire' | 'triangles' | 'bounds';
export type ControlMode = 'orbit' | 'fly' | 'walk';
export type MeasureKind = 'line' | 'area' | 'height';

export interface Attribution {
  text: string;
  licence: string | null;
  url: string | null;
}

/** Where the middle of a city's focus lies on Earth, in degrees. */
export interface GeoLocation {
  latitude_deg: number;
  longitude_deg: number;
  /** From the grid's north to true north, clockwise. */
  north_deg: number;
}

/** What is known of a city before its first tile. All texts are from outside: show them as text, never as markup. */
export interface Manifest {
  name: string;
  title: string;
  version: string;
  /** For example `EPSG:7415`; `null` for local metres. */
  crs: string | null;
  bounds: [min: Position, max: Position];
  focus: [min: [number, number], max: [number, number]];
  ground_z_m: number;
  cell_m: number;
  attribution: Attribution[];
  /** `null` if the bake does not know the coordinate system. */
  location?: GeoLocation | null;
  /** Of which day the city is, and the name that all its versions have in common. */
  release?: { of: string; date: string } | null;
  [other: string]: unknown;
}

export interface ViewerOptions {
  /** Tolerated error on the screen, in pixels. */
  tau: number;
  /** Frames a second while the view moves, 5 to 240: kept by a larger error, up to four times `tau`, then by fewer pixels. */
  fps: number;
  /**
   * Metres, ascending, such as `50,100,200`: up to the first one the finest level of detail is drawn, and beyond each one the next
   * coarser level. If empty, `tau` decides. At most 16.
   */
  distances: string;
  shading: Shading;
  /** How the city is shown: a white model by day, light as measured, or even light for reports. */
  look: 'model' | 'physical' | 'paper';
  /** Whether the sun casts shadows. */
  shadows: boolean;
  /** Whether ground and buildings stop the camera; `null` as long as the mode decides. */
  collision: boolean | null;
  mode: ControlMode;
  /** Whether the time of day runs. */
  day: boolean;
}

export interface ReadyDetail {
  manifest: Manifest;
}

export interface ProgressDetail {
  /** Tiles that the view lacks. */
  missing: number;
  /** Bytes that were transferred. */
  bytes: number;
  requests: number;
  /** Whether the picture is complete at the tolerated error. */
  final: boolean;
}

export interface PickResult {
  position: Position;
  /** From the camera, in metres. */
  distance: number;
  /** The position on Earth, if it is known where the city lies: degrees, and metres of the city's system. */
  lon?: number;
  lat?: number;
  height?: number;
}

/** Why objects cannot be read, searched, coloured or filtered, for pages that say it in words of their own. Errors have it as `fault`. */
export interface Fault {
  /**
   * Of a filter: `syntax`, `name`, `type`, `size`. Of colours: `attribute`, `palette`, `long`. Of a city: `objects` (it has none), `area` (the
   * link opens a part without them). Of what is fetched: `missing`, `busy`, `damaged`, `network`, `unusable`.
   */
  code: string;
  /** Of a filter: the number of the character, from 1. */
  at?: number;
  /** Of a filter, in English. */
  why?: string;
  /** The attribute or palette that is unknown. */
  name?: string | null;
}

export interface PickDetail extends PickResult {
  /** The object at this position; `null` if there is none, or if it could not be fetched. */
  object: ObjectDescription | null;
  /** Why the object could not be fetched, in English, or empty. */
  error: string;
  /** The same for programs. */
  fault?: Fault;
  /** Whether the user held Shift: the object is added to the selection, or removed from it. */
  adds: boolean;
}

/** What is known of an object. All texts are of the city's source: show them as text, never as markup. */
export interface ObjectDescription {
  /** Number of the object in this city. It stays when other parts of the city are updated. */
  id: number;
  identifier: string;
  /** Identifier of the object that it is a part of. */
  parent: string | null;
  kind: string;
  /** By name, in the order in which they are shown. What the object lacks is from its parent, or else from its parts. Dates are texts. */
  attributes: Record<string, string | number | boolean>;
  /** Middle of its box, or of its parts' if it has no shape. */
  centre: Position | null;
  /** Parts of an object without a shape. */
  parts: number[];
}

/** A hit of a search. */
export interface SearchHit {
  text: string;
  /** Number of the object. */
  object: number;
  /** 0 or 1. */
  typos: number;
}

/** An attribute of the city's objects. */
export interface Attribute {
  name: string;
  type: 'text' | 'integer' | 'float' | 'bool' | 'date';
  unit?: string;
  /** Number of objects that have it. */
  count: number;
  /** Smallest and largest value. Dates are days since 1970-01-01. */
  min?: number;
  max?: number;
  /** Number of different values, if they are few. */
  distinct?: number;
  /** The most frequent values with their counts. */
  top: [value: string, count: number][];
}

/** What an office lets people read of an attribute. */
export interface AttributeLabel {
  /** Instead of its name. */
  title?: string;
  /** The same by codes of languages in lower case, such as `pt-br`. */
  titles?: Record<string, string>;
  /** Attributes with a number come first, the smallest at the top. */
  order?: number;
  /** Panels do not show it. */
  hidden?: boolean;
}

export interface Schema {
  /** Number of objects. */
  objects: number;
  /** Names of attributes by which objects can be coloured. */
  colorBy: string[];
  palettes: string[];
  attributes: Attribute[];
  /** By the name of the attribute. */
  labels: Record<string, AttributeLabel>;
}

/** How objects are coloured and filtered. What is left out asks for nothing. */
export interface ColorRules {
  /** An attribute, `height` or `kind`. */
  attribute?: string;
  /** One of the schema's palettes. */
  palette?: string;
  /** Values of the ends of the palette. Dates are days since 1970-01-01. */
  range?: [low: number, high: number] | null;
  /** Objects that pass, as in `yearOfConstruction < 1900 && height > 20`. */
  filter?: string;
  /** How the others are drawn: pale, not at all, or as they are. */
  others?: 'ghost' | 'hide' | 'keep';
  /** Objects with larger values of the attribute are hidden. */
  upTo?: number | null;
}

/** What colours mean. */
export interface Legend {
  title: string;
  /** The title by codes of languages, if there are several. */
  titles?: Record<string, string>;
  unit: string | null;
  /** Classes, or values along the ramp. The last entry is for objects without a value. */
  entries: { rgb: [r: number, g: number, b: number]; label: string }[];
  /** `null` for classes. */
  ramp: { range: [first: number, last: number]; stops: [r: number, g: number, b: number][] } | null;
}

export interface Colors {
  /** `null` without an attribute. */
  legend: Legend | null;
  /** Number of objects that pass the filter. */
  passing: number;
}

export interface CameraDetail {
  camera: CameraText;
  position: Position;
  /** Degrees clockwise from the grid's north. */
  azimuth: number;
  /** Degrees, positive upwards. */
  pitch: number;
}

export interface StatusDetail {
  /** `null` if all is well; `waiting` for a server that does not answer yet, and is asked again. */
  kind: null | 'loading' | 'waiting' | 'offline' | 'error';
  /** What is wrong, with `error` and `waiting`. */
  text: string;
}

export interface AdapterDetail {
  kind: 'cpu' | 'gpu';
  name: string;
  /** Why the CPU draws. */
  why?: string;
}

export interface FrameDetail extends CameraDetail {
  mode: ControlMode;
  time: TimeText | null;
  /** Metres per device pixel at the surface in the middle of the view; `null` for the sky. */
  metersPerPixel: number | null;
  final: boolean;
}

export interface InsulaCityEventMap {
  /** The first picture of the city was drawn. */
  ready: CustomEvent<ReadyDetail>;
  progress: CustomEvent<ProgressDetail>;
  /**
   * The user clicked or tapped the city, or pressed Enter. The object is selected and outlined then, unless a listener calls
   * `preventDefault()`.
   */
  pick: CustomEvent<PickDetail>;
  camera: CustomEvent<CameraDetail>;
  status: CustomEvent<StatusDetail>;
  adapter: CustomEvent<AdapterDetail>;
  /** Other objects are selected. */
  selection: CustomEvent<{ objects: ObjectDescription[] }>;
  /** Objects have other colours. */
  colors: CustomEvent<Colors & { rules: ColorRules | null }>;
  /** Options have changed, by the page or by a key. */
  options: CustomEvent<ViewerOptions & { changes: Partial<ViewerOptions> }>;
  /** A picture was drawn. */
  frame: CustomEvent<FrameDetail>;
}

export interface MarkerValues {
  position: Position;
  /** Content of the page; its lower middle is put at the position. It becomes a child of the city. */
  element?: HTMLElement;
  /** A label, instead of an element. */
  text?: string;
}

export interface Marker {
  moveTo(position: Position): void;
  remove(): void;
}

export interface LineValues {
  points: Position[];
  /** Any colour of CSS. */
  color?: string;
  /** In CSS pixels. */
  width?: number;
}

export interface Line {
  remove(): void;
}

/** `<insula-city src="https://host/v1/cities/NAME">` */
export class InsulaCity extends HTMLElement {
  /** Address of the city: `/v1/cities/NAME` of a server, or a folder of a static site. */
  src: string | null;
  /** First view. Setting it later moves the camera there at once. It does not follow the camera: see `view`. */
  camera: CameraText | null;
  time: TimeText | null;
  /** What draws: `auto` by default. */
  adapter: 'auto' | 'cpu' | 'gpu' | null;
  /** Tolerated error on the screen, in pixels. */
  tau: string | null;
  /** `cooperative` leaves the wheel, and moves of one finger, to the page as long as the element does not have the focus. */
  gestures: 'cooperative' | null;
  /** A page that has the manifest already saves a request by setting it before the viewer starts. */
  manifest: Manifest | null;
  /** Current options. Change them with `setOptions`. */
  readonly options: Readonly<ViewerOptions>;
  /** The last drawn picture; `null` before the first. */
  readonly view: FrameDetail | null;

  /**
   * Resolves when the first picture of the city is shown, at once if it is. Rejects if the city cannot be shown.
   */
  whenReady(): Promise<Manifest>;
  /** The camera of the last picture; `null` before the first, and if it is not known where on Earth the city lies. */
  readonly place: EarthCamera | null;
  /**
   * Flies to a camera, or centres a position in the city's system without turning. What is left out of a camera on Earth stays as it
   * is. At once, if the user asked for less motion. Resolves when the camera has arrived and a picture from there is shown. Fails if a
   * number is out of range, or, for a camera on Earth, if it is over 500 km from the city, or it is not known where the city lies.
   */
  flyTo(place: Partial<EarthCamera> | CameraText | number[], options?: { seconds?: number }): Promise<void>;
  /**
   * Flies to where bounds fill the element. By default with the present heading, 45 degrees downwards, with 32 CSS pixels free at each
   * side. Fails like `flyTo`.
   */
  fitBounds(bounds: Bounds, options?: { heading?: number; pitch?: number; padding?: number; seconds?: number }): Promise<void>;
  /**
   * Where the last picture shows a place, in CSS pixels from the upper left corner of the element, whether or not something hides it;
   * `null` behind the camera. Fails if it is not known where the city lies.
   */
  project(place: Place): { x: number; y: number } | null;
  /** The place at a height, by default the ground plane's, that is shown at a position of the element; `null` for the sky. */
  unproject(x: number, y: number, options?: { height?: number }): LonLat | null;
  /** Degrees of a position, within a thousandth of its distance from the middle of the city. */
  toLonLat(position: [x: number, y: number, z?: number]): LonLat;
  toPosition(place: Place): Position;
  /** Draws an object of the city in a colour or not at all; `null` ends that. Lasts until `src` changes. Fails if a colour is none. */
  setFeatureState(id: number, state: FeatureState | null): void;
  getFeatureState(id: number): FeatureState;
  /**
   * Lays features on the surfaces of the city, roofs as well: polygons, lines and points, whose heights are ignored. Parts are hidden
   * where something is in front of them. Features that are malformed are skipped and listed. Fails if the value is no GeoJSON, has more
   * than 2,000,000 positions, or if it is not known where the city lies.
   */
  addGeoJson(
    data: object,
    style?: FigureStyle | ((feature: { id: string | number | null; properties: any }) => FigureStyle),
  ): Promise<GeoJsonLayer>;
  /**
   * Adds the triangles of a model to the city until `src` changes. They have the colours of its materials and corners, not its
   * textures; they cast shadows, and hide what is behind them. Resolves to a number for `removeModel`. Fails if the file cannot be read,
   * has more than 262,144 triangles, or needs an extension such as compression, and if it is not known where the city lies.
   */
  addModel(model: ModelValues): Promise<number>;
  /** Removes a model. Returns whether there was one of this number. */
  removeModel(id: number): boolean;
  /** Sets the time of the light. */
  setTime(time: TimeText): void;
  /**
   * Colours and filters objects; `null` gives them their own colours. Fails if the rules are invalid or the city has no objects, and
   * then changes nothing. No tile is fetched again. The error has a `fault`.
   */
  setColors(rules: ColorRules | null): Promise<Colors>;
  /** The selected objects. */
  readonly selection: ObjectDescription[];
  /** Selects and outlines these objects and no others. */
  select(ids: number | number[]): Promise<ObjectDescription[]>;
  /** What is known of an object; `null` if there is none of this number. */
  describe(id: number): Promise<ObjectDescription | null>;
  /** Attributes and palettes. Fails if the city has no objects. */
  schema(): Promise<Schema>;
  /** Objects by names, addresses and identifiers, the best first; `null` if the city has no search. */
  search(text: string, options?: { limit?: number }): Promise<SearchHit[] | null>;
  setOptions(changes: Partial<Omit<ViewerOptions, 'collision'>> & { collision?: boolean }): void;
  /** The surface at a position of the element in CSS pixels; `null` for the sky. */
  pick(x: number, y: number): Promise<PickResult | null>;
  /** A picture as PNG, by default as large as the element in device pixels. */
  screenshot(options?: { width?: number; height?: number; caption?: string | string[] }): Promise<Blob>;
  /** Adds a marker, which is hidden where something is in front of it. */
  addMarker(marker: MarkerValues): Marker;
  /** Adds a line, whose parts are hidden where something is in front of them. */
  addLine(line: LineValues): Line;
  measure(action: 'start' | 'stop' | 'kind' | 'undo' | 'clear', kind?: MeasureKind): void;
  /** Moves the camera like a gesture. Angles are in radians: `turn` to the left, `tilt` upwards. */
  steer(op: 'turn' | 'tilt', values: { rad: number }): void;
  steer(op: 'zoom', values: { factor: number }): void;
  steer(op: 'drag' | 'pan', values: { dx: number; dy: number }): void;
  steer(op: 'north' | 'home'): void;
  /** Takes keys from another target, such as the document, instead of only while the element has the focus. */
  listenForKeys(target: EventTarget): void;
  /** Restarts the viewer, for example after an error. */
  restart(): void;

  addEventListener<K extends keyof InsulaCityEventMap>(
    type: K,
    listener: (this: InsulaCity, event: InsulaCityEventMap[K]) => unknown,
    options?: boolean | AddEventListenerOptions,
  ): void;
  addEventListener(
    type: string,
    listener: EventListenerOrEventListenerObject,
    options?: boolean | AddEventListenerOptions,
  ): void;
  removeEventListener<K extends keyof InsulaCityEventMap>(
    type: K,
    listener: (this: InsulaCity, event: InsulaCityEventMap[K]) => unknown,
    options?: boolean | EventListenerOptions,
  ): void;
  removeEventListener(
    type: string,
    listener: EventListenerOrEventListenerObject,
    options?: boolean | EventListenerOptions,
  ): void;
}

/**
 * Gives the elements of the page the words of another language: those of a file `language-CODE.json` of the package, or some of them.
 * What is left out is English.
 */
export function setTexts(texts: object): void;

declare global {
  interface HTMLElementTagNameMap {
    'insula-city': InsulaCity;
  }
}
