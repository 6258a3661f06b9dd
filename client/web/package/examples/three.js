/** A city in a scene of three.js, with a ball that houses hide. Drag to look around. */

import { insulaObject } from '../insula-three.js';
import * as THREE from './vendor/three.module.js';

const canvas = document.querySelector('#scene');
const state = document.querySelector('#state');
const query = new URLSearchParams(location.search);

const renderer = new THREE.WebGLRenderer({ canvas });
const scene = new THREE.Scene();
scene.background = new THREE.Color('#dfe7ec');
const camera = new THREE.PerspectiveCamera(40, 1, 1, 20_000);
const ball = new THREE.Mesh(new THREE.SphereGeometry(30), new THREE.MeshBasicMaterial({ color: '#d8432e' }));
scene.add(ball);

let heading = 0.6;
/** Draws the scene from a direction, 700 m away. The ground is the plane of x and z. */
function draw() {
  camera.position.set(600 * Math.sin(heading), 350, 600 * Math.cos(heading));
  camera.lookAt(0, 0, 0);
  renderer.render(scene, camera);
}

const city = insulaObject(THREE, {
  url: query.get('src') ?? '/v1/cities/demo',
  time: query.get('time'),
  onOpen: draw,
  onFrame: draw,
});
// Its z is up.
city.rotation.x = -Math.PI / 2;
scene.add(city);
// For the console of the browser.
Object.assign(globalThis, { city, ball, camera, renderer, draw });

new ResizeObserver(() => {
  const { clientWidth: width, clientHeight: height } = canvas;
  renderer.setSize(width, height, false);
  camera.aspect = width / height;
  camera.updateProjectionMatrix();
  draw();
}).observe(canvas);

canvas.addEventListener('pointermove', ({ buttons, movementX }) => {
  if (!buttons) return;
  heading -= movementX / 200;
  draw();
});
canvas.addEventListener('click', async ({ offsetX, offsetY }) => {
  const place = { x: (2 * offsetX) / canvas.clientWidth - 1, y: 1 - (2 * offsetY) / canvas.clientHeight };
  const hit = await city.pick(place);
  state.textContent = hit ? `${hit.object?.kind ?? 'surface'}, ${hit.height.toFixed(1)} m` : 'nothing';
});
