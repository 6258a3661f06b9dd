/** A city as an object of three.js: cast at the camera that renders it, and drawn with its depth. */

import { MOVED, OVERLAP, RUN, SAME_EYE_M, STILL, pointsOf } from './cast-shaders.js';
import { aboveHeight, castAxes, castPlace, castToClip, castView, eyeDistance, pixelSize, product, viewToCast } from './cast-view.js';
import { Caster } from './caster.js';

/**
 * An object for a scene: documented for users in insula-three.d.ts of the package.
 * @param {any} THREE The module that the scene is made with.
 * @param {any} options
 */
export function insulaObject(THREE, options) {
  const names = ['colours', 'distances', 'castToClip', 'viewToCast', 'tangents', 'lowest', 'pointSize', 'stride'];
  const uniforms = Object.fromEntries(names.map((name) => [name, { value: null }]));
  [uniforms.tangents.value, uniforms.lowest.value] = [new THREE.Vector2(), new THREE.Vector4()];
  const [fullMatrix, planeMatrix] = [new THREE.Matrix4(), new THREE.Matrix3()];
  [uniforms.castToClip.value, uniforms.viewToCast.value] = [fullMatrix, planeMatrix];
  const material = ({ vertex, fragment }) => {
    // three.js writes the version itself.
    const [vertexShader, fragmentShader] = [vertex, fragment].map((source) => source.replace(/^#version.*\n/, ''));
    return new THREE.RawShaderMaterial({ vertexShader, fragmentShader, uniforms, glslVersion: THREE.GLSL3, blending: THREE.NoBlending });
  };
  const positions = (count) => new THREE.BufferAttribute(new Float32Array(3 * count), 3);
  const screen = new THREE.BufferGeometry().setAttribute('position', positions(3));
  const runs = new THREE.InstancedBufferGeometry().setAttribute('position', positions(RUN));
  const object = new THREE.Mesh(screen, material(STILL));
  const points = new THREE.Points(runs, material(MOVED));
  for (const part of [object, points]) Object.assign(part, { frustumCulled: false, raycast: () => {} });
  object.add(points);
  // The object decides before what is drawn.
  points.renderOrder = 1;
  screen.setDrawRange(0, 0);
  runs.instanceCount = 0;

  /** @type {import('./cast-view.js').CastView|null} */
  let view = null;
  /** @type {object|null} */
  let shown = null;
  const caster = new Caster(options);

  const show = (frame) => {
    const { width, height, colours, distances } = frame;
    [uniforms.colours, uniforms.distances].forEach(({ value }) => value?.dispose());
    const isBitmap = colours instanceof ImageBitmap;
    const colour = isBitmap ? new THREE.Texture(colours) : new THREE.DataTexture(new Uint8Array(colours.buffer), width, height);
    const distance = new THREE.DataTexture(distances, width, height, THREE.RedFormat, THREE.FloatType);
    Object.assign(colour, { minFilter: THREE.LinearFilter, magFilter: THREE.LinearFilter, generateMipmaps: false, flipY: false });
    [uniforms.colours.value, uniforms.distances.value] = [colour, distance];
    for (const texture of [colour, distance]) texture.needsUpdate = true;
    shown = frame;
  };

  object.onBeforeRender = (renderer, _, camera) => {
    screen.setDrawRange(0, 0);
    runs.instanceCount = 0;
    const { manifest, frame } = caster;
    if (!manifest) return;
    const { x: width, y: height } = renderer.getDrawingBufferSize(new THREE.Vector2());
    const [low, high] = manifest.focus;
    const anchor = options.origin ?? [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, manifest.ground_z_m];
    const toView = product(camera.matrixWorldInverse.elements, object.matrixWorld.elements);
    view = castView(product(camera.projectionMatrix.elements, toView), anchor, width, height);
    if (!view) return caster.rest();
    caster.cast(view.camera, view.width, view.height);
    if (!frame) return;
    if (frame !== shown) show(frame);
    const cast = castAxes(frame);
    const isStill = eyeDistance(view, cast) < SAME_EYE_M;
    uniforms.tangents.value.set(cast.tanX, cast.tanY);
    uniforms.lowest.value.fromArray(aboveHeight(cast, caster.lowestM));
    fullMatrix.fromArray(castToClip(view, cast));
    planeMatrix.fromArray(viewToCast(view, cast));
    const { stride, count } = pointsOf(frame);
    uniforms.stride.value = stride;
    uniforms.pointSize.value = OVERLAP * stride * pixelSize(view, cast, frame.height, height);
    if (isStill) screen.setDrawRange(0, 3);
    else runs.instanceCount = Math.ceil(count / RUN);
  };

  /** What is drawn at a place of the screen: -1 to 1, to the right and up. */
  const pick = async ({ x, y }) => {
    if (!view) return null;
    const at = castPlace(view, x, y);
    return caster.pick(at.x, at.y);
  };
  const dispose = () => {
    caster.dispose();
    [uniforms.colours, uniforms.distances].forEach(({ value }) => value?.dispose());
    [object, points].forEach((part) => [part.geometry, part.material].forEach((made) => made.dispose()));
  };
  return Object.assign(object, { caster, pick, dispose });
}
