/** Uses the types of the package as pages do: what is wrong must not compile. */
import type { EarthCamera, GeoJsonLayer } from '@insula/viewer';
import { createCaster, type Cast } from '@insula/viewer/caster';
import { insulaLayer } from '@insula/viewer/maplibre';
import type {} from '@insula/viewer/react';
import { insulaObject } from '@insula/viewer/three';
import { useEffect, useRef } from 'react';

const city = document.querySelector('insula-city')!;
const camera: EarthCamera = { lon: 7.42, lat: 43.74, height: 300, heading: 20, pitch: -30, fov: 40 };
city.addEventListener('pick', ({ detail: { lon, object } }) => console.log(lon?.toFixed(5), object?.kind));
await city.flyTo({ lon: 7.42, lat: 43.74 }, { seconds: 1 });
await city.flyTo(camera);
await city.fitBounds([7.4, 43.7, 7.5, 43.8], { padding: 10 });
const at: { x: number; y: number } | null = city.project([7.42, 43.74]);
const layer: GeoJsonLayer = await city.addGeoJson({ type: 'FeatureCollection', features: [] }, ({ id }) => ({ color: String(id) }));
layer.setState(at === null ? null : 'a', { hidden: true });
city.setFeatureState(3, { color: null });
const model: number = await city.addModel({ url: 'tower.glb', lon: 7.42, lat: 43.74, heading: 20 });
const wasThere: boolean = city.removeModel(model);
// @ts-expect-error: a model has a place.
await city.addModel({ url: wasThere ? 'a.glb' : 'b.glb' });
// @ts-expect-error: a longitude is a number.
await city.flyTo({ lon: '7.42', lat: 43.74 });
const caster = await createCaster({ url: '/v1/cities/monaco', onFrame: ({ distances }: Cast) => console.log(distances.length) });
caster.setCamera(camera, { width: 640, height: 400 });
const map = insulaLayer({ url: '/v1/cities/monaco', labels: ['places'] });
console.log((await map.pick({ x: 1, y: 2 }))?.object?.kind, map.hides([7.42, 43.74]));
insulaObject({ Mesh: class {} }, { url: '/v1/cities/monaco', origin: [0, 0, 0] }).dispose();
// @ts-expect-error: there is no such state.
city.setFeatureState(3, { colour: 'red' });

// @ts-expect-error: the detail of this event has no camera.
export const wrong = <insula-city onready={({ detail }) => console.log(detail.camera)} />;

export function City({ src }: { src: string }) {
  const element = useRef<HTMLElementTagNameMap['insula-city']>(null);
  useEffect(() => {
    element.current?.whenReady().then(({ title }) => console.log(title));
  }, []);
  return <insula-city ref={element} src={src} adapter="cpu" onpick={({ detail: { object } }) => console.log(object?.kind)} />;
}
