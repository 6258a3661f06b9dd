/** The worker of an element: its frames are shown on canvases of the page. */

import { CpuCanvas } from './canvas.js';
import { Engine, serve } from './engine-core.js';

serve(new Engine(({ canvasCpu }) => new CpuCanvas(canvasCpu)));
