/**
 * Checks degrees, cameras, figures, options and keys of the page against known values, and what it stores: node page_geometry.mjs FOLDER
 *
 * FOLDER has the modules of the page. Fails at the first that is wrong.
 */
import assert from 'node:assert';
import fs from 'node:fs';
import path from 'node:path';

const folder = process.argv[2];

/** The address of a module with those that it imports: without a package.json, Node takes the files for CommonJS. */
function address(name) {
  const text = fs.readFileSync(path.join(folder, name), 'utf8');
  const joined = text.replace(/from '\.\/([a-z-]+\.js)'/g, (_, imported) => `from '${address(imported)}'`);
  return `data:text/javascript;base64,${Buffer.from(joined).toString('base64')}`;
}

const { lonLatGrid, placeNear } = await import(address('lon-lat.js'));
const { cameraText, earthCamera, fitting, projected, unprojected } = await import(address('earth-camera.js'));
const { shapesOf } = await import(address('geojson.js'));
const { cells, dense } = await import(address('plan-cells.js'));
const { codeOf } = await import(address('key-table.js'));
const { readModel } = await import(address('model-reader.js'));
const { validChanges } = await import(address('viewer-options.js'));
const { BookmarkStore } = await import(address('bookmark-store.js'));

const near = (found, expected, tolerance) => {
  const isNear = found.length === expected.length && found.every((value, i) => Math.abs(value - expected[i]) <= tolerance);
  assert(isNear, `${found} is not ${expected}`);
};
const focus = [[84_900, 447_400], [85_100, 447_600]];
const delft = { focus, location: { longitude_deg: 4.3577, latitude_deg: 52.0114, north_deg: 0.81 } };
const grid = lonLatGrid(delft);
const SIZE = { width: 800, height: 400 };
const CAMERA = '85000,447500,120,30,-40,60';

/** What a browser stores, until it is full. */
class Storage extends Map {
  isFull = false;
  getItem = (key) => this.get(key) ?? null;
  removeItem = (key) => this.delete(key);
  setItem(key, text) {
    if (this.isFull) throw new Error('full');
    this.set(key, text);
  }
}

/** A GLB of a triangle, with changes. */
function triangle(change = () => {}) {
  const binary = Buffer.concat([Buffer.from(new Float32Array([0, 0, 0, 2, 0, 0, 0, 1, -4]).buffer), Buffer.from(new Uint16Array([0, 1, 2, 0]).buffer)]);
  const root = {
    asset: { version: '2.0' },
    nodes: [{ mesh: 0, translation: [10, 0, 0], children: [1] }, { mesh: 0, scale: [-1, 1, 1] }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, indices: 1, material: 0 }] }],
    materials: [{ pbrMetallicRoughness: { baseColorFactor: [1, 0.2158605, 0, 1] } }],
    accessors: [{ bufferView: 0, componentType: 5126, count: 3, type: 'VEC3' }, { bufferView: 1, componentType: 5123, count: 3, type: 'SCALAR' }],
    bufferViews: [{ buffer: 0, byteLength: 36 }, { buffer: 0, byteOffset: 36, byteLength: 6 }],
    buffers: [{ byteLength: 44 }],
  };
  change(root);
  const json = Buffer.from(JSON.stringify(root));
  const words = (...numbers) => Buffer.from(new Uint32Array(numbers).buffer);
  const parts = [words(json.length, 0x4e4f534a), json, words(binary.length, 0x004e4942), binary];
  const length = parts.reduce((sum, part) => sum + part.length, 12);
  return new Uint8Array(Buffer.concat([words(0x46546c67, 2, length), ...parts])).buffer;
}

/** What the console was told while `action` ran. */
function warnings(action) {
  const { warn } = console;
  const said = [];
  console.warn = (text) => said.push(text);
  try {
    action();
  } finally {
    console.warn = warn;
  }
  return said;
}

const tests = {
  'degrees are those of the native client'() {
    near(grid.toXy([4.3577, 52.0114]), [85_000, 447_500], 1e-6);
    const north = grid.toXy([4.3577, 52.1014]);
    assert(Math.abs(Math.hypot(north[0] - 85_000, north[1] - 447_500) - 10_014) < 10, String(north));
    const east = grid.toXy([4.5037, 52.0114]);
    assert(Math.abs(Math.hypot(east[0] - 85_000, east[1] - 447_500) - 10_026) < 10, String(east));
    assert.equal(lonLatGrid({ focus, location: null }), null);
  },
  'an option with a wrong value is named, with the values that it has'() {
    const good = { tau: 2, fps: 60, distances: '50,100', shading: 'ao', look: 'paper', shadows: false, mode: 'walk', day: true };
    assert.deepEqual(warnings(() => assert.deepEqual(validChanges({ ...good, collision: undefined }), good)), []);
    for (const [wrong, ...words] of [
      [{ tau: 0 }, 'tau cannot be 0', 'a number above 0'],
      [{ distances: '100,50' }, "distances cannot be '100,50'", 'ascending'],
      [{ shading: 'Lit' }, "shading cannot be 'Lit'", 'lit, albedo'],
      [{ look: 'photo' }, "look cannot be 'photo'", 'model, physical, paper'],
      [{ shadows: 'no' }, "shadows cannot be 'no'", 'true, false'],
      [{ collision: null }, 'collision cannot be null', 'true, false'],
      [{ shadow: true }, 'no option shadow', 'tau, fps'],
      [{ toString: 1 }, 'no option toString'],
    ]) {
      const said = warnings(() => assert.deepEqual(validChanges(wrong), {}));
      assert(said.length === 1 && words.every((word) => said[0].includes(word)), `${JSON.stringify(wrong)}: ${said}`);
    }
    const others = () => assert.deepEqual(validChanges({ url: 'a', tau: 3 }, { hasOthers: true }), { tau: 3 });
    assert.deepEqual(warnings(others), []);
  },
  'models are triangles with z up, and colours'() {
    const { positions, colours, triangles } = readModel(triangle());
    near([...positions], [10, 0, 0, 12, 0, 0, 10, 4, 1, 10, 0, 0, 8, 0, 0, 10, 4, 1], 1e-6);
    // A mirrored node keeps what is outside.
    assert.deepEqual([...triangles], [0, 1, 2, 3, 5, 4]);
    assert.deepEqual([...colours.slice(0, 3)], [255, 128, 0]);
    const strip = readModel(triangle(({ meshes: [{ primitives: [primitive] }] }) => Object.assign(primitive, { mode: 5, indices: undefined })));
    assert.deepEqual([...strip.triangles.slice(0, 3)], [0, 1, 2]);
  },
  'models that cannot be read say why'() {
    for (const [change, words] of [
      [(root) => (root.extensionsRequired = ['KHR_draco_mesh_compression']), 'KHR_draco_mesh_compression'],
      [(root) => (root.accessors[0].count = 4e9), 'too many vertices'],
      [(root) => (root.accessors[0].count = 4), 'behind the file'],
      [(root) => Object.assign(root.accessors[1], { bufferView: 0, byteOffset: 12 }), 'does not exist'],
      [(root) => (root.bufferViews[0].byteOffset = -4), 'behind the file'],
      [(root) => (root.bufferViews[0].buffer = 1), 'files beside it'],
      [(root) => (root.nodes[1].children = [0]), 'no triangles'],
      [(root) => Object.assign(root, { scenes: [{ nodes: [0] }], nodes: [{ children: [0] }] }), 'nested too deeply'],
      [(root) => (root.nodes[0].translation = ['east', 0, 0]), 'no number'],
    ]) {
      assert.throws(() => readModel(triangle(change)), ({ message }) => message.includes(words), words);
    }
    const whole = triangle();
    for (let length = 0; length < whole.byteLength; length++) assert.throws(() => readModel(whole.slice(0, length)), Error, String(length));
  },
  'degrees come back'() {
    for (const place of [[4.3577, 52.0114], [4.5, 52.1], [4.2, 51.9]]) near(grid.toLonLat(grid.toXy(place)), place, 1e-9);
    const fiji = lonLatGrid({ focus, location: { longitude_deg: 179.99, latitude_deg: -17, north_deg: -1 } });
    near(fiji.toLonLat(fiji.toXy([-179.98, -17.01])), [-179.98, -17.01], 1e-9);
  },
  'a typed place is metres or degrees in either order'() {
    const city = { ...delft, bounds: [[84_500, 447_000, 0], [85_500, 448_000, 50]], ground_z_m: 2 };
    near(placeNear([85_100, 447_600], city), [85_100, 447_600, 2], 0);
    near(placeNear([85_100, 447_600, 9], city), [85_100, 447_600, 9], 0);
    for (const typed of [[4.3577, 52.0114], [52.0114, 4.3577]]) near(placeNear(typed, city), [85_000, 447_500, 2], 1e-6);
    for (const away of [[5.3577, 52.0114], [84_000, 457_500], [85_100, 447_600, 1e6]]) assert.equal(placeNear(away, city), null);
    assert.equal(placeNear([4.3577, 52.0114], { ...city, location: null }), null);
  },
  'cameras come back'() {
    const camera = earthCamera(grid, CAMERA);
    near([camera.heading, camera.pitch, camera.fov, camera.height], [29.19, -40, 60, 120], 0.01);
    near(cameraText(grid, camera).split(',').map(Number), CAMERA.split(',').map(Number), 1e-4);
    for (const wrong of [{ lat: 91 }, { lon: NaN }, { pitch: -91 }, { fov: 0 }, { heading: Infinity }, { height: undefined }]) {
      assert.throws(() => cameraText(grid, { ...camera, ...wrong }), RangeError, JSON.stringify(wrong));
    }
  },
  'positions of the screen come back'() {
    const point = unprojected(CAMERA, SIZE, 100, 250, 3);
    assert.equal(Math.round(point[2] * 1e6), 3e6);
    const { x, y } = projected(CAMERA, SIZE, point);
    near([x, y], [100, 250], 1e-6);
    assert.equal(unprojected('0,0,10,0,10,60', SIZE, 400, 10, 0), null, 'the sky');
    assert.equal(projected(CAMERA, SIZE, [84_900, 447_300, 120]), null, 'behind the camera');
    // Straight ahead is the middle; what lies to the east is on the right when one looks north.
    near(Object.values(projected('0,0,0,0,0,90', SIZE, [0, 10, 0])), [400, 200], 1e-9);
    near(Object.values(projected('0,0,0,0,0,90', SIZE, [10, 10, 10])), [600, 0], 1e-9);
  },
  'bounds fill the view'() {
    const points = [[0, 0, 5], [100, 0, 5], [100, 60, 5], [0, 60, 5]];
    const camera = fitting(points, { azimuth: 20, pitch: -50, fov: 40 }, SIZE, 32);
    const places = points.map((point) => projected(camera, SIZE, point));
    const free = places.map(({ x, y }) => Math.min(x, y, SIZE.width - x, SIZE.height - y));
    assert(Math.min(...free) > 31.9 && Math.min(...free) < 33, String(free));
  },
  'features that are wrong are named'() {
    const feature = (geometry) => ({ type: 'Feature', id: 7, properties: null, geometry });
    const good = [
      { type: 'Point', coordinates: [4, 52, 9] },
      { type: 'MultiLineString', coordinates: [[[4, 52], [4.1, 52]], [[4, 52], [4, 52.1]]] },
      { type: 'GeometryCollection', geometries: [{ type: 'Polygon', coordinates: [[[4, 52], [4.1, 52], [4, 52.1], [4, 52]]] }] },
    ];
    const bad = [null, 5, { type: 'Point' }, { type: 'Point', coordinates: ['4', 52] }, { type: 'LineString', coordinates: [[4, 52]] },
      { type: 'toString', coordinates: [] }, { type: 'Polygon', coordinates: [] }, { type: 'MultiPolygon', coordinates: 3 }];
    const { shapes, skipped } = shapesOf({ type: 'FeatureCollection', features: [...good, ...bad].map(feature) }, grid);
    assert.deepEqual(shapes.map(({ points, lines, polygons }) => [points.length, lines.length, polygons.length]), [[1, 0, 0], [0, 2, 0], [0, 0, 1]]);
    assert.deepEqual(skipped.map(({ index }) => index), [3, 4, 5, 6, 7, 8, 9, 10]);
    for (const nothing of [null, [], 'x', { type: 'FeatureCollection' }].slice(0, 3)) assert.throws(() => shapesOf(nothing, grid), TypeError);
  },
  'keys are what is written on them, and directions where they lie'() {
    const keys = {
      US: [['m', 'KeyM', 'KeyM'], ['/', 'Slash', 'Slash'], ['?', 'Slash', 'F1'], ['=', 'Equal', 'Equal'], ['w', 'KeyW', 'KeyW']],
      German: [['z', 'KeyY', 'KeyZ', true], ['y', 'KeyZ', 'KeyY', true], ['/', 'Digit7', 'Slash'], ['-', 'Slash', 'Minus'], ['+', 'BracketRight', 'Equal']],
      French: [['m', 'Semicolon', 'KeyM'], ['z', 'KeyW', 'KeyW'], ['z', 'KeyW', 'KeyZ', true], ['q', 'KeyA', 'KeyA'], ['C', 'KeyC', 'KeyC']],
      Dvorak: [['o', 'KeyS', 'KeyS'], ['h', 'KeyJ', 'KeyH']],
      Russian: [['ь', 'KeyM', 'KeyM'], ['я', 'KeyZ', 'KeyZ', true]],
      any: [['Escape', 'Escape', 'Escape'], ['ArrowUp', 'ArrowUp', 'ArrowUp']],
    };
    for (const [keyboard, all] of Object.entries(keys)) {
      for (const [key, code, meant, ctrlKey = false] of all) assert.equal(codeOf({ key, code, ctrlKey }), meant, `${keyboard}: ${key}`);
    }
  },
  'two tabs keep all bookmarks'() {
    globalThis.localStorage = new Storage();
    const [one, other] = [new BookmarkStore('city'), new BookmarkStore('city')];
    const view = { camera: CAMERA, time: null };
    assert(one.add({ name: 'a', ...view }) && other.add({ name: 'b', ...view }) && one.add({ name: 'c', ...view }));
    assert.deepEqual(other.list.map(({ name }) => name), ['c', 'b', 'a']);
    one.remove(other.list[1]);
    assert.deepEqual(other.list.map(({ name }) => name), ['c', 'a']);
    // What finds no room lasts as long as the page.
    globalThis.localStorage.isFull = true;
    assert.equal(one.add({ name: 'd', ...view }), false);
    assert.deepEqual(one.list.map(({ name }) => name), ['d', 'c', 'a']);
    for (const damaged of ['[null, 5, {"name": "x"}]', '{}', 'null', '{']) {
      globalThis.localStorage = new Storage([['insula.bookmarks.other', damaged]]);
      assert.deepEqual(new BookmarkStore('other').list, []);
    }
  },
  'cells have the area of their polygon'() {
    const square = (low, high) => [[low, low], [high, low], [high, high], [low, high], [low, low]];
    const area = (ring) => ring.reduce((sum, [x, y], i) => {
      const [nx, ny] = ring[(i + 1) % ring.length];
      return sum + (x * ny - nx * y) / 2;
    }, 0);
    for (const hole of [square(10, 30), square(10, 30).reverse()]) {
      const all = cells([square(0, 50), hole]);
      const sum = all.flat().map(area).reduce((a, b) => a + b);
      assert(Math.abs(sum - 2100) < 1e-6, String(sum));
    }
    const line = dense([[0, 0], [30, 0], [30, 3]]);
    assert.equal(line.length, 7);
    near(line.at(-1), [30, 3], 0);
  },
};

for (const [name, test] of Object.entries(tests)) {
  try {
    test();
  } catch (error) {
    console.error(`FAILED ${name}: ${error.message}`);
    process.exitCode = 1;
  }
}
