/** `<insula-city>` in JSX, for TypeScript with React 19: `import '@insula/viewer/react';`. Needs `@types/react`. */

import type { DetailedHTMLProps, HTMLAttributes } from 'react';
import type { CameraText, InsulaCity, TimeText } from './insula-viewer.js';

export interface InsulaCityProperties extends DetailedHTMLProps<HTMLAttributes<InsulaCity>, InsulaCity> {
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
