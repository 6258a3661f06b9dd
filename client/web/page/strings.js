/**
 * All texts of the page. For a translation, copy this file and change `language`, `direction` and the texts.
 *
 * Texts with values are functions, so that a translation may order the words freely.
 */

const LANGUAGE = 'en-GB';
const plurals = new Intl.PluralRules(LANGUAGE);
const numbers = new Intl.NumberFormat(LANGUAGE);

/**
 * The form for a number, with `#` replaced by the number.
 * @param {number} n
 * @param {{other: string} & Partial<Record<Intl.LDMLPluralRule, string>>} forms
 * @returns {string}
 */
function plural(n, forms) {
  return (forms[plurals.select(n)] ?? forms.other).replaceAll('#', numbers.format(n));
}

const winds = ['north', 'north-east', 'east', 'south-east', 'south', 'south-west', 'west', 'north-west'];

export const strings = {
  language: LANGUAGE,
  direction: 'ltr',

  element: {
    label: (title) => `3D view of ${title}`,
    labelWithoutTitle: '3D view of a city',
    role: '3D view',
    keys: 'Arrow keys move, Page Up and Page Down change the height, plus and minus zoom.',
    notRunning: 'the viewer is not running',
    noCamera: 'a camera is X,Y,Z,AZIMUTH,PITCH,FOV in metres and degrees',
  },

  toolbar: {
    label: 'Tools',
    more: 'More',
    search: 'Search',
    view: 'View',
    objects: 'Objects',
    colors: 'Colours',
    time: 'Time',
    measure: 'Measure',
    bookmarks: 'Bookmarks',
    share: 'Share',
    picture: 'Picture',
    fullScreen: 'Full screen',
    endFullScreen: 'Leave full screen',
    dark: 'Dark appearance',
    light: 'Light appearance',
    help: 'Help',
    about: 'About',
  },

  panel: {
    close: 'Close',
    closeNamed: (title) => `Close ${title}`,
  },

  search: {
    title: 'Search',
    label: 'Name, address, coordinates or bookmark',
    hint: (crs) => `Names and identifiers of the city; x, y or x, y, z in ${crs}; or the name of a bookmark`,
    example: (x, y) => `${x}, ${y}`,
    localMetres: 'local metres',
    go: 'Go',
    goTo: (place) => `Go to ${place}`,
    results: 'Places',
    found: (n) => plural(n, { one: '# place found', other: '# places found' }),
    objects: 'Objects',
    typos: 'similar',
    failed: (why) => `The search failed: ${why}`,
    notNumber: (text) => `Nothing is called “${text}”, and it is no number`,
    twoOrThree: 'Write two or three numbers',
    far: (x0, x1, y0, y1) => `Far from the city, which has x ${x0} to ${x1}, y ${y0} to ${y1}`,
    moved: (place) => `Moved to ${place}`,
  },

  view: {
    title: 'View',
    mode: 'Steering',
    modes: { orbit: 'Orbit', fly: 'Fly', walk: 'Walk' },
    modeHints: {
      orbit: 'Dragging turns around the point ahead.',
      fly: 'Dragging looks around. The wheel changes the speed.',
      walk: 'Moves on the ground, and stops at walls.',
    },
    look: 'Look',
    looks: { model: 'Model', physical: 'Physical light', paper: 'Paper' },
    shading: 'Shading',
    shadings: {
      lit: 'Sun and sky',
      albedo: 'Colour',
      ao: 'Ambient occlusion',
      normal: 'Normals',
      lod: 'Levels of detail',
      kind: 'Kinds of columns',
    },
    layers: 'Show',
    shadows: 'Sun shadows',
    collision: 'Stop at buildings and ground',
    counters: 'Developer counters',
    detail: 'Detail',
    fine: 'finer',
    coarse: 'coarser',
    detailValue: (px) => `errors up to ${px} px`,
    move: 'Turn and tilt',
    turnLeft: 'Turn left',
    turnRight: 'Turn right',
    tiltUp: 'Look up',
    tiltDown: 'Look down',
  },

  objects: {
    title: 'Objects',
    none: 'Click a building to read what is known of it. Shift click selects several.',
    count: (n) => plural(n, { one: '# object', other: '# objects' }),
    find: 'Find an attribute',
    copy: 'Copy as JSON',
    copied: 'Attributes copied',
    copyFailed: 'Copying was refused',
    clear: 'Deselect',
    goTo: 'Go to',
    goToNamed: (name) => `Go to ${name}`,
    unnamed: (id) => `object ${id}`,
    kind: (kind, id) => `${kind} ${id}`,
    partOf: (kind, id, parent) => `${kind} ${id}, part of ${parent}`,
    selected: (name) => `Selected ${name}`,
    failed: (why) => `The attributes are not there: ${why}`,
  },

  colors: {
    title: 'Colours and filter',
    attribute: 'Colour by',
    own: 'own colours',
    palette: 'Palette',
    defaultPalette: 'default',
    from: 'From',
    to: 'To',
    limit: 'Only up to a value (with years, the city grows)',
    upTo: 'Up to',
    filter: 'Filter',
    example: 'height > 20',
    filterHint: 'For example yearOfConstruction < 1900 && height > 20',
    others: 'Other objects',
    ghost: 'Pale',
    hide: 'Hidden',
    reset: 'Own colours',
    passing: (n) => plural(n, { one: '# object passes', other: '# objects pass' }),
    failed: (why) => `No colours: ${why}`,
    legend: 'Legend',
  },

  time: {
    title: 'Time of day',
    hour: 'Solar time',
    date: 'Date',
    run: 'Run the day',
    pause: 'Pause',
    days: 'Days of the year',
    running: 'The day is running',
    paused: 'The day is paused',
  },

  measure: {
    title: 'Measure',
    kind: 'What to measure',
    kinds: { line: 'Line', area: 'Area', height: 'Height' },
    hints: {
      line: 'Click points of a line. With the keyboard, Enter sets a point in the middle of the view.',
      area: 'Click the corners of an area. It is measured horizontally.',
      height: 'Click two points to measure their difference in height.',
    },
    result: 'Result',
    none: 'No points yet',
    undo: 'Undo',
    clear: 'Clear',
    done: 'Done',
    nothing: 'Nothing to measure at this point',
  },

  bookmarks: {
    title: 'Bookmarks',
    name: 'Name of this view',
    defaultName: (n) => `View ${numbers.format(n)}`,
    add: 'Add',
    open: (name) => `Open ${name}`,
    remove: (name) => `Delete ${name}`,
    list: 'Saved views',
    empty: 'No saved views yet. They stay in this browser.',
    added: (name) => `Saved ${name}`,
    removed: (name) => `Deleted ${name}`,
    temporary: 'This browser stores nothing, so bookmarks last until the page is closed.',
  },

  share: {
    title: 'Share',
    link: 'Link to this view',
    nativeLink: 'Link for the Insula program',
    copy: 'Copy',
    copyNamed: (name) => `Copy: ${name}`,
    copied: 'Link copied',
    failed: 'Copying was refused: the link is selected, press Ctrl C',
    send: 'Send …',
  },

  picture: {
    title: 'Picture',
    size: 'Size',
    window: (width, height) => `As shown, ${width} × ${height}`,
    size2: (width, height) => `${width} × ${height}`,
    caption: 'Caption',
    save: 'Save picture',
    busy: 'Drawing the picture …',
    saved: 'Picture saved',
    failed: (why) => `The picture failed: ${why}`,
  },

  about: {
    title: 'About',
    drawnBy: 'Drawn by',
    sources: 'Sources',
    system: 'Reference system',
    version: 'Version',
    extent: 'Extent',
    metres: (x, y) => `${numbers.format(x)} m × ${numbers.format(y)} m`,
    transferred: 'Transferred',
    generated: 'Windows are generated on walls without pictures.',
    software: 'Shown with Insula, free software under MIT or Apache 2.0. This page loads nothing from other hosts.',
  },

  adapter: {
    cpu: 'the CPU',
    cpuBecause: (why) => `the CPU, because ${why}`,
    gpu: (name) => name || 'the graphics adapter',
    notice: (adapter) => `Drawn by ${adapter}.`,
    dismiss: 'Hide this notice',
    lost: (why) => `the graphics device was lost (${why})`,
    /** Reasons of the engine in words for people. @type {Record<string, string>} */
    reasons: {
      'no WebGPU on plain http': 'browsers offer WebGPU only on https and localhost',
      'this browser has no WebGPU': 'this browser has no WebGPU',
      'the CPU was asked for': 'this page asks for it',
      'no graphics adapter': 'this device offers no graphics adapter',
      'a software adapter is slower than the CPU ray-caster': 'this device has only a software graphics adapter',
    },
  },

  status: {
    loading: 'Loading',
    loadingCity: (title) => `Loading ${title} …`,
    offline: 'Offline: the city is shown as far as it was loaded',
    error: 'The city cannot be shown',
    retry: 'Try again',
    ready: (title) => `${title} is shown`,
    online: 'Connected again',
  },

  furniture: {
    label: 'Compass and scale',
    compass: (wind, degrees) => `Looking ${wind}, ${degrees}°. Turn to the north`,
    winds,
    north: 'N',
    scale: (length) => `Scale: ${length}`,
    tiles: (n) => plural(n, { one: 'loading # tile', other: 'loading # tiles' }),
    coordinates: (x, y, z) => `E ${x}  N ${y}  height ${z} m`,
    sky: 'sky',
    zoomIn: 'Zoom in',
    zoomOut: 'Zoom out',
    home: 'First view',
    navigation: 'Zoom',
    attribution: 'Sources',
    counters: (frame) => `${frame.ms} ms, 1/${frame.divisor} resolution, ${frame.samples} samples, ${frame.bytes}`,
  },

  announcements: {
    mode: (name) => `Steering: ${name}`,
    shading: (name) => `Shading: ${name}`,
    on: (name) => `${name}: on`,
    off: (name) => `${name}: off`,
  },

  help: {
    title: 'Help',
    keys: 'Keys',
    key: 'Key or gesture',
    action: 'Action',
    singleKeys: 'Keys work everywhere on this page',
    singleKeysHint: 'If off, keys act only while the city has the focus.',
    /** Keys and what they do. @type {[string, string][]} */
    table: [
      ['drag', 'turn around the point ahead (orbit), look around (fly, walk)'],
      ['right drag, Ctrl drag', 'move sideways'],
      ['wheel', 'distance (orbit), speed (fly, walk)'],
      ['double click', 'go to this place'],
      ['two fingers', 'move, zoom and turn; tilt by dragging both up or down'],
      ['W A S D, arrows', 'move; with Shift, four times as fast'],
      ['Q E, Page Down and Up', 'move down and up'],
      ['+ and −', 'zoom'],
      ['Enter', 'pick or measure in the middle of the view'],
      ['H, Home', 'back to the first view'],
      ['U', 'north up'],
      ['F', 'orbit, fly or walk'],
      ['X', 'stop at buildings and the ground, or not; on when walking'],
      ['1 to 6', 'light, colour, ambient occlusion, normals, levels, kinds of columns'],
      ['L', 'sun shadows on or off'],
      ['T', 'run or pause the time of day'],
      ['O', 'panel of time and date'],
      ['/', 'search'],
      ['B', 'bookmark this view'],
      ['click, Shift click', 'select an object, or several, and read their attributes'],
      ['G', 'colours and filter of objects'],
      ['V', 'bookmarks'],
      ['C', 'copy a link to this view'],
      ['M', 'measure lines, then areas, then heights'],
      ['Backspace, Ctrl Z', 'remove the last measured point'],
      ['P', 'save a picture'],
      ['I', 'developer counters'],
      ['F11', 'full screen'],
      ['F1, ?', 'this help'],
      ['Esc', 'end measuring, close a panel'],
      ['gamepad', 'left stick moves, right stick looks, triggers go down and up'],
    ],
  },
};
