/** Types of the object of three.js scenes. */

import type { CastHit, CasterOptions, Caster } from './insula-caster.js';
import type { Position } from './insula-viewer.js';

export interface InsulaObjectOptions extends CasterOptions {
  /** The position of the city that is the object's origin: the middle of the city on its ground plane by default. */
  origin?: Position;
}

/** What the object has besides the members of a `Mesh`. */
export interface InsulaObject {
  readonly caster: Caster;
  /** What is drawn at a place of the screen: -1 to 1, to the right and up, as for a `Raycaster`. */
  pick(place: { x: number; y: number }): Promise<CastHit | null>;
  /** Ends the workers, and frees what the renderer has. */
  dispose(): void;
}

/**
 * A city for a scene of `WebGLRenderer`, with the depth of what it shows: metres to the east, to the north and up. `THREE` is the module
 * that the scene is made with. Draw the scene again when `onFrame` is called. Logarithmic and reversed depths are not supported.
 */
export function insulaObject<Mesh = any>(
  THREE: { Mesh: new (...values: any[]) => Mesh; [name: string]: any },
  options: InsulaObjectOptions,
): Mesh & InsulaObject;
