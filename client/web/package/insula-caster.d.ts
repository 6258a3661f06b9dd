/** Types of casters: pictures of a city, with distances, at the cameras of others. */

import type {
  AdapterDetail,
  CameraText,
  ColorRules,
  Colors,
  EarthCamera,
  FeatureState,
  Manifest,
  ObjectDescription,
  Position,
  Schema,
  StatusDetail,
  TimeText,
  ViewerOptions,
} from './insula-viewer.js';

/** A picture of a city. */
export interface Cast {
  camera: CameraText;
  /** Of the distances. A picture of a GPU may be larger, while the camera moves. */
  width: number;
  height: number;
  /** Row by row from the top: red, green, blue and 255 in sRGB, or a picture of a GPU, which is closed when the next one comes. */
  colours: Uint8ClampedArray | ImageBitmap;
  /** Metres along the ray of each pixel, row by row from the top; infinite where nothing of the city was hit. */
  distances: Float32Array;
  /** Whether no later cast of this camera will be finer. `onFrame` is called again when that turns out. */
  isFinal: boolean;
}

/** A city, and how it is cast. */
export interface CityOptions extends Partial<Pick<ViewerOptions, 'tau' | 'fps' | 'distances' | 'shading' | 'look' | 'shadows'>> {
  /** The city: `https://HOST/v1/cities/NAME`, or the folder of a city in a static site. */
  url: string;
  time?: TimeText;
  /** What draws: `auto` by default. */
  adapter?: 'auto' | 'cpu' | 'gpu';
  /** Whether the ground is drawn: without it, what is lower than half a metre above the ground plane is not, so for cities without hills. */
  ground?: boolean;
  onFrame?(frame: Cast): void;
  /** By default, the console has what is wrong. */
  onStatus?(status: StatusDetail): void;
  onAdapter?(adapter: AdapterDetail): void;
}

export interface CasterOptions extends CityOptions {
  onOpen?(caster: Caster): void;
}

/** What is at a place of a cast. */
export interface CastHit {
  position: Position;
  /** From the camera, in metres. */
  distance: number;
  /** Degrees; `null` if it is not known where on Earth the city lies. */
  lon: number | null;
  lat: number | null;
  /** In metres of the city's system. */
  height: number;
  /** `null` if the city has no objects, or none here. */
  object: ObjectDescription | null;
}

/** What a layer of a map, an object of a scene and a caster have in common. */
export interface CityControls {
  /** Colours and filters objects; `null` gives them their own colours. Fails if the rules are invalid, and then changes nothing. */
  setColors(rules: ColorRules | null): Promise<Colors>;
  /** Changes the filter alone, as in `height > 20`; `null` ends it. */
  setFilter(filter: string | null): Promise<Colors>;
  /** Draws an object in a colour or not at all; `null` ends that. */
  setFeatureState(id: number, state: FeatureState | null): void;
  getFeatureState(id: number): FeatureState;
  setGround(isShown: boolean): void;
  setTime(time: TimeText): void;
  setOptions(changes: Partial<ViewerOptions>): void;
}

/** A city without an element of its own. */
export interface Caster extends CityControls {}
export class Caster {
  constructor(options: CasterOptions);
  /** Resolves when the manifest is there. Rejects if there is no city, or no answer; in the latter case it is asked again. */
  readonly opened: Promise<Caster>;
  /** `null` before. */
  readonly manifest: Manifest | null;
  /** The last cast. */
  readonly frame: Cast | null;
  /** Casts at a camera from now on, in pixels. Frames come to `onFrame`: coarse ones while the camera changes, and then finer ones. */
  setCamera(camera: EarthCamera | CameraText, size: { width: number; height: number }): void;
  /** The camera of a cast in degrees. */
  place(frame: Cast): EarthCamera | null;
  /** What is at shares of the width and height, from the upper left corner; `null` for the sky. */
  pick(x: number, y: number): Promise<CastHit | null>;
  describe(id: number): Promise<ObjectDescription | null>;
  schema(): Promise<Schema>;
  outline(ids: number | number[]): void;
  /** Nothing is cast or fetched until the next camera. */
  rest(): void;
  /** Ends the workers. */
  dispose(): void;
}

/** A caster whose manifest is there. */
export function createCaster(options: CasterOptions): Promise<Caster>;
