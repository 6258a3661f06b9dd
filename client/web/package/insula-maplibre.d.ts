/** Types of the layer of MapLibre maps. */

import type { CastHit, CityControls, CityOptions, Caster } from './insula-caster.js';
import type { Manifest } from './insula-viewer.js';

export interface InsulaLayerOptions extends CityOptions {
  /** `insula` by default. */
  id?: string;
  minzoom?: number;
  maxzoom?: number;
  /**
   * Metres that are added to the heights of the city. By default its ground plane is at the map's height of zero; in a map with terrain,
   * its heights are those of the terrain.
   */
  altitude?: number;
  /** Layers of symbols whose labels houses hide. Their features are points with ids, and their opacity does not depend on the zoom. */
  labels?: string[];
  onOpen?(manifest: Manifest): void;
}

/** A layer for `map.addLayer`: a `CustomLayerInterface` of MapLibre GL JS 5 or newer. */
export interface InsulaLayer extends CityControls {
  readonly id: string;
  readonly type: 'custom';
  readonly renderingMode: '3d';
  /** `null` while the layer is not in a map. */
  readonly caster: Caster | null;
  /** Whether the picture of the map's view is there, and will not become finer. */
  readonly isFinal: boolean;
  /** What the layer shows at a point in CSS pixels of the map, such as `event.point`; `null` where it shows nothing. */
  pick(point: { x: number; y: number }): Promise<CastHit | null>;
  /**
   * Whether the city stands before a place, whose height is above the map's zero and by default the map's own, by more than `slackM`
   * metres; `null` where that is not known: out of view, or while the map moves.
   */
  hides(place: [lon: number, lat: number, height?: number], slackM?: number): boolean | null;
  onAdd(map: any, gl: WebGL2RenderingContext): void;
  onRemove(map: any, gl: WebGL2RenderingContext): void;
  render(gl: WebGL2RenderingContext, options: any): void;
}

export function insulaLayer(options: InsulaLayerOptions): InsulaLayer;
