/** The element in a plain page: events, a marker and a line, a flight, a picture. */

import '../insula-city.js';

const city = document.querySelector('#city');
const show = (id, text) => (document.getElementById(id).textContent = text);

city.addEventListener('ready', ({ detail: { manifest } }) => {
  show('state', `${manifest.title} is shown.`);
  const [[x0, y0], [x1, y1]] = manifest.focus;
  const z = manifest.ground_z_m + 2;
  const pin = document.createElement('span');
  pin.className = 'pin';
  pin.textContent = 'Middle';
  city.addMarker({ position: [(x0 + x1) / 2, (y0 + y1) / 2, z + 30], element: pin });
  const corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]];
  city.addLine({ points: corners.map(([x, y]) => [x, y, z]), color: 'orange', width: 3 });
});
city.addEventListener('pick', ({ detail: { position, distance } }) => {
  show('picked', `${position.map((v) => v.toFixed(1)).join(', ')}, ${distance.toFixed(0)} m away`);
});
city.addEventListener('status', ({ detail: { kind, text } }) => kind === 'error' && show('state', text));
city.addEventListener('adapter', ({ detail: { kind, why } }) => why && show('state', `Drawn by the ${kind}: ${why}.`));

document.getElementById('down').addEventListener('click', () => {
  const { position, azimuth } = city.view;
  city.flyTo([...position, azimuth, -89, 60].join(','), { seconds: 2 });
});
document.getElementById('evening').addEventListener('click', () => city.setTime('2025-06-21T20:15'));
document.getElementById('save').addEventListener('click', async () => {
  const blob = await city.screenshot({ width: 1280, height: 720, caption: city.manifest.attribution.map(({ text }) => text) });
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = 'city.png';
  link.click();
});

// Set last, so that no event is missed.
city.src = new URLSearchParams(location.search).get('src') ?? '/v1/cities/demo';
