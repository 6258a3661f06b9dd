/** `<insula-city>` in JSX, for TypeScript with React 19: `import '@insula/viewer/react';`. Needs `@types/react`. */

import type { DetailedHTMLProps, HTMLAttributes } from 'react';
import type { CameraText, InsulaCity, InsulaCityEventMap, TimeText } from './insula-viewer.js';

/** Listeners, as React 19 names those of an element that is not of HTML: `onready` for the event `ready`. */
export type InsulaCityListeners = {
  [Type in keyof InsulaCityEventMap as `on${Type}`]?: (event: InsulaCityEventMap[Type]) => void;
};

export interface InsulaCityProperties extends DetailedHTMLProps<HTMLAttributes<InsulaCity>, InsulaCity>, InsulaCityListeners {
  src?: string;
  camera?: CameraText;
  time?: TimeText;
  adapter?: 'auto' | 'cpu' | 'gpu';
  tau?: number | string;
  gestures?: 'cooperative';
}

declare module 'react' {
  namespace JSX {
    interface IntrinsicElements {
      'insula-city': InsulaCityProperties;
    }
  }
}
