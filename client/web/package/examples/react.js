/** A React component around the element, without a build step. React 18 needs a reference for events of custom elements. */

import '../insula-city.js';

const { createElement, useEffect, useRef, useState } = globalThis.React;

/**
 * A city. `onPick` and `onReady` get the details of the events; `time` may change at any time.
 * @param {{src: string, time: string, onPick: (detail: object) => void, onReady: (detail: object) => void}} properties
 */
function City({ src, time, onPick, onReady }) {
  const city = useRef(null);
  useEffect(() => {
    const element = city.current;
    const listeners = { pick: ({ detail }) => onPick(detail), ready: ({ detail }) => onReady(detail) };
    Object.entries(listeners).forEach(([name, listener]) => element.addEventListener(name, listener));
    return () => Object.entries(listeners).forEach(([name, listener]) => element.removeEventListener(name, listener));
  }, [onPick, onReady]);
  return createElement('insula-city', { ref: city, src, time });
}

/** Two viewers that share the time of the light. The second one can be removed. */
function App({ src }) {
  const [hour, setHour] = useState(16);
  const [text, setText] = useState('Click a city.');
  const [hasSecond, setHasSecond] = useState(true);
  const [onPick] = useState(() => ({ position }) => setText(position.map((v) => v.toFixed(1)).join(', ')));
  const [onReady] = useState(() => ({ manifest }) => setText(`${manifest.title} is shown.`));
  const time = `2025-06-21T${String(hour).padStart(2, '0')}:00`;
  const city = (key) => createElement(City, { key, src, time, onPick, onReady });
  const change = (event) => setHour(Number(event.target.value));
  const slider = { type: 'range', min: 0, max: 23, value: hour, onChange: change, 'aria-label': 'Hour' };
  const toggle = { type: 'button', onClick: () => setHasSecond(!hasSecond) };
  return createElement(
    'div',
    {},
    createElement('div', { className: 'beside' }, city('first'), hasSecond && city('second')),
    createElement(
      'div',
      { className: 'row' },
      createElement('input', slider),
      createElement('button', toggle, hasSecond ? 'Remove the second' : 'Add a second'),
    ),
    createElement('output', { id: 'state' }, text),
  );
}

const src = new URLSearchParams(location.search).get('src') ?? '/v1/cities/demo';
globalThis.ReactDOM.createRoot(document.getElementById('root')).render(createElement(App, { src }));
