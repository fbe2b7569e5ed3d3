'use strict';
// All coordinates are in pixels of the picture, from its outer corner.

const $ = id => document.getElementById(id);
const canvas = $('picture');
const pen = canvas.getContext('2d');
const COLOURS = {tracking: '#3cdc3c', searching: '#ffa000', lost: '#e63c3c'};
// Below this movement, in pixels of the screen, a drag is a click; a finger slips more than a mouse.
const CLICK = 5, TAP = 12;
// Width, in pixels, that small pictures are enlarged to, about, by a whole factor.
const LEGIBLE = 1024;
// The radius of a two-dimensional Gaussian's 90 % ellipse, in standard deviations.
const RADIUS = Math.sqrt(-2 * Math.log(0.1));

// The time span of the plot, in seconds.
const SHOWN = 60;

let socket, picture = null, header = null, drag = null, paused = false, recording = false;
let tracker = '', shownTracker = '';

function ask(request) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(request));
  else if (request.do !== 'shown') tell('not sent: there is no connection to vtrack select', true);
}

function connect() {
  const address = new URL('ws', location.href);
  address.protocol = address.protocol.replace('http', 'ws');
  socket = new WebSocket(address);
  socket.binaryType = 'blob';
  socket.onopen = () => { if ($('particles').checked) want(); };
  let next = null;
  socket.onmessage = async event => {
    if (typeof event.data !== 'string') {
      const image = await createImageBitmap(event.data);
      if (drag) { waiting = [image, next]; return; }
      show(image, next);
      return;
    }
    const message = JSON.parse(event.data);
    if (message.kind === 'picture') next = message;
    if (message.kind === 'state') tellState(message);
    if (message.kind === 'told') tell(message.text, message.wrong);
    if (message.kind === 'parameters') fill(message.rows);
    if (message.kind === 'values') update(message.values);
  };
  socket.onclose = () => {
    tellName('no connection');
    setTimeout(connect, 1000);
  };
}

// While a box is drawn the picture is frozen, for the box belongs to it; the next one waits here.
let waiting = null;

function show(image, message) {
  [picture, header] = [image, message];
  draw();
  tellState(message);
  plot(message);
  ask({do: 'shown'});
}

function draw() {
  if (!picture) return;
  // Small pictures are enlarged, so that lines are drawn at the screen's resolution.
  const enlarged = Math.max(1, Math.round(LEGIBLE / header.width));
  if (canvas.width !== enlarged * header.width || canvas.height !== enlarged * header.height) {
    [canvas.width, canvas.height] = [enlarged * header.width, enlarged * header.height];
  }
  pen.setTransform(enlarged, 0, 0, enlarged, 0, 0);
  pen.drawImage(picture, 0, 0, header.width, header.height);
  const thin = 1 / shown().scale;
  pen.lineWidth = 2 * thin;
  pen.lineJoin = 'round';
  const trail = header.trail;
  pen.strokeStyle = '#ffdc00';
  pen.beginPath();
  trail.forEach(([x, y]) => pen.lineTo(x, y));
  pen.stroke();
  pen.fillStyle = '#00c8ff';
  for (const [x, y] of header.particles || []) pen.fillRect(x - thin, y - thin, 2 * thin, 2 * thin);
  if (header.box) {
    pen.strokeStyle = COLOURS[header.state.name] || '#fff';
    pen.strokeRect(...header.box);
    if (header.covariance) ellipse(header.box, header.covariance);
  }
  if (drag && drag.moved) {
    pen.setLineDash([6 * thin, 4 * thin]);
    pen.strokeStyle = '#fff';
    pen.strokeRect(drag.x, drag.y, drag.toX - drag.x, drag.toY - drag.y);
    pen.setLineDash([]);
  }
}

function ellipse([x, y, width, height], [xx, xy, yy]) {
  const mean = (xx + yy) / 2, half = Math.hypot((xx - yy) / 2, xy);
  const axis = value => RADIUS * Math.sqrt(Math.max(value, 0));
  pen.beginPath();
  pen.ellipse(x + width / 2, y + height / 2, axis(mean + half), axis(mean - half),
    Math.atan2(2 * xy, xx - yy) / 2, 0, 2 * Math.PI);
  pen.stroke();
}

// Only changes are written, for a screen reader speaks what is written here.
function tellName(name) {
  if ($('state').textContent === name) return;
  $('state').textContent = name;
  $('state').style.borderColor = COLOURS[name] || 'transparent';
}

function tellState(message) {
  const {state} = message;
  tellName(state.name || 'no node');
  $('confidence').textContent = state.confidence || '-';
  $('meter').value = state.confidence || 0;
  $('tracker').textContent = tracker = state.tracker || '-';
  $('ms').textContent = state.ms_per_frame ? `${Number(state.ms_per_frame).toFixed(1)} ms` : '-';
  paused = state.name === 'paused';
  $('pause').textContent = paused ? 'Go on' : 'Pause';
  recording = message.recording;
  $('record').textContent = recording ? 'Stop recording' : 'Record';
  if (tracker !== shownTracker) showOwn();
}

// For the plot: time in s, centre, speed in pixels/s and confidence; null where there's none.
let past = [];

function plot({stamp, state, box}) {
  const time = Number(BigInt(stamp) / 1000000n) / 1000, last = past.at(-1);
  if (last && time <= last.time) {
    // The same frame again (ignored), or a stream that begins again.
    if (time === last.time) return;
    past = [];
  }
  const centre = box ? [box[0] + box[2] / 2, box[1] + box[3] / 2] : null;
  const speed = centre && last && last.centre ?
    Math.hypot(centre[0] - last.centre[0], centre[1] - last.centre[1]) / (time - last.time) : null;
  past.push({time, centre, speed, confidence: box && state.confidence ? Number(state.confidence) : null});
  past = past.filter(one => one.time > time - SHOWN);
  const fastest = Math.max(1, ...past.map(one => one.speed || 0));
  $('fastest').textContent = Math.round(fastest);
  const line = value => {
    let broken = true;
    return past.map(one => {
      const y = value(one), move = broken;
      broken = y === null;
      return broken ? '' : `${move ? 'M' : 'L'}${(one.time - time).toFixed(2)},${(19.5 - 19 * y).toFixed(2)}`;
    }).join('');
  };
  $('confidences').setAttribute('d', line(one => one.confidence));
  $('speeds').setAttribute('d', line(one => one.speed === null ? null : one.speed / fastest));
}

let fading;

function tell(text, wrong) {
  $('told').textContent = text;
  // The text is cleared after a while, when it may no longer be true.
  clearTimeout(fading);
  fading = setTimeout(() => { $('told').textContent = ''; }, 15000);
  $('told').className = wrong ? 'wrong' : '';
}

// Returns where the picture is on the page: object-fit: contain leaves margins where the aspect
// ratios differ.
function shown() {
  const area = canvas.getBoundingClientRect(), {width, height} = header;
  const scale = Math.min(area.width / width, area.height / height);
  return {scale, left: area.left + (area.width - width * scale) / 2,
          top: area.top + (area.height - height * scale) / 2};
}

// Returns the point of the picture that is nearest to the pointer, and whether the pointer is there.
function place(event) {
  const {scale, left, top} = shown();
  const x = (event.clientX - left) / scale, y = (event.clientY - top) / scale;
  const inX = Math.min(Math.max(x, 0), header.width), inY = Math.min(Math.max(y, 0), header.height);
  return [inX, inY, inX === x && inY === y];
}

// A box is drawn by one finger; others, such as those that hold the phone, are ignored meanwhile.
const drawing = event => drag && event.pointerId === drag.pointer;

canvas.onpointerdown = event => {
  if (!header || drag || event.button) return;
  canvas.setPointerCapture(event.pointerId);
  const [x, y, inside] = place(event);
  drag = {x, y, inside, toX: x, toY: y, left: event.clientX, top: event.clientY, moved: false, pointer: event.pointerId};
};

canvas.onpointermove = event => {
  if (!drawing(event)) return;
  [drag.toX, drag.toY] = place(event);
  const least = event.pointerType === 'touch' ? TAP : CLICK;
  drag.moved ||= Math.hypot(event.clientX - drag.left, event.clientY - drag.top) >= least;
  draw();
};

canvas.onpointerup = event => {
  if (!drawing(event)) return;
  const {x, y, inside, toX, toY, moved} = drag;
  tell('');
  if (paused) {
    // The node has no such image, and would refuse the selection only when it goes on.
    tell('not sent: press Go on first', true);
  } else if (moved) {
    ask({do: 'box', stamp: header.stamp, x: Math.min(x, toX), y: Math.min(y, toY),
         width: Math.abs(toX - x), height: Math.abs(toY - y)});
  } else if (inside) {
    ask({do: 'click', stamp: header.stamp, x, y});
  }
  endDrag();
};

canvas.onpointercancel = event => { if (drawing(event)) endDrag(); };

function endDrag() {
  drag = null;
  if (waiting) {
    const [image, message] = waiting;
    waiting = null;
    show(image, message);
  } else {
    draw();
  }
}

$('reset').onclick = () => ask({do: 'reset'});
$('record').onclick = () => ask({do: 'record', on: !recording});
$('reinit').onclick = () => ask({do: 'reinit'});
const SIZES = {'+': 'larger', '-': 'smaller'};
for (const size of Object.values(SIZES)) $(size).onclick = () => ask({do: size});
document.onkeydown = event => {
  const typing = event.target.closest('form') || event.ctrlKey || event.altKey || event.metaKey;
  if (event.key === 'Escape' && drag) endDrag();
  if (!typing && !event.repeat && event.key in SIZES) ask({do: SIZES[event.key]});
};
$('pause').onclick = () => ask({do: 'enable', on: paused});

// The parameters that the form has inputs for, without their values.
let inputs = '';

function fill(rows) {
  const asked = JSON.stringify(rows.map(({value, ...row}) => row));
  if (asked === inputs) {
    // The same inputs again, with the values in force: what has the focus keeps it.
    update(Object.fromEntries(rows.map(row => [row.name, row.value])));
    return;
  }
  inputs = asked;
  const groups = new Map();
  for (const row of rows) {
    const owner = row.name.includes('.') ? row.name.split('.')[0] : '';
    if (!groups.has(owner)) groups.set(owner, []);
    groups.get(owner).push(row);
  }
  const named = [...groups].sort(([a], [b]) => a.localeCompare(b));
  $('parameters').replaceChildren(...named.map(([owner, own]) => {
    const set = document.createElement('fieldset');
    set.dataset.owner = owner;
    const legend = document.createElement('legend');
    legend.textContent = owner || 'Node';
    own.sort((a, b) => (b.name === 'tracker') - (a.name === 'tracker'));
    set.replaceChildren(legend, ...own.map(input));
    return set;
  }));
  showOwn();
}

// The input that is being typed in.
let typed = null;
$('parameters').addEventListener('input', event => { typed = event.target; });
$('parameters').addEventListener('change', () => { typed = null; });

// Shows values that were set here or elsewhere, but not over what is being typed.
function update(values) {
  for (const [name, value] of Object.entries(values)) {
    const field = $('parameters').elements.namedItem(name);
    if (!field || field === typed && field === document.activeElement) continue;
    if (field.type === 'checkbox') field.checked = value;
    else field.value = value;
    field.oninput?.();
  }
}

// Shows the node's parameters and those of the tracker in use, hides other trackers'.
function showOwn() {
  shownTracker = tracker;
  for (const set of $('parameters').children) {
    set.hidden = Boolean(set.dataset.owner) && set.dataset.owner !== tracker;
  }
}

// An empty field is no number, though Number('') is 0.
const numberIn = field => field.value.trim() ? Number(field.value.replace(',', '.')) : NaN;

function input(row) {
  const label = document.createElement('label');
  label.append(row.name.slice(row.name.indexOf('.') + 1));
  const field = document.createElement(row.choices ? 'select' : 'input');
  field.title = label.title = row.text;
  if (row.choices) {
    field.append(...row.choices.map(choice => new Option(choice, choice)));
  } else if (row.kind === 'bool') {
    field.type = 'checkbox';
  } else if (row.kind === 'int') {
    field.type = 'number';
    if ('low' in row) field.min = row.low;
    if ('high' in row) field.max = row.high;
  } else if (row.kind === 'float') {
    // Not of type number: in some languages a browser makes 45 of 0,45 there.
    field.inputMode = 'decimal';
  }
  if (row.kind === 'bool') field.checked = row.value;
  else field.value = row.value;
  field.name = row.name;
  field.onchange = () => {
    // What is no number is sent as it is, and the node says what is valid.
    const number = row.kind === 'int' || row.kind === 'float' ? numberIn(field) : NaN;
    const value = row.kind === 'bool' ? field.checked : Number.isFinite(number) ? number : field.value;
    ask({do: 'set', name: row.name, kind: row.kind, value});
  };
  label.append(field);
  if ('low' in row && 'high' in row) label.append(slider(row, field));
  return label;
}

// A slider for a bounded number; quadratic, so finer near the lower bound, where most values are.
function slider(row, field) {
  const one = document.createElement('input'), range = row.high - row.low;
  const chosen = () => {
    const value = row.low + range * one.value ** 2;
    return row.kind === 'int' ? Math.round(value) : Number(value.toPrecision(3));
  };
  const say = () => one.setAttribute('aria-valuetext', field.value);
  const follow = () => {
    // Steps of the arrow keys may be too small for another whole number: several add up.
    const value = numberIn(field);
    if (value >= row.low && value !== chosen()) one.value = Math.sqrt((value - row.low) / range);
    say();
  };
  Object.assign(one, {type: 'range', min: 0, max: 1, step: 'any'});
  one.setAttribute('aria-label', row.name);
  one.oninput = () => {
    field.value = chosen();
    say();
  };
  one.onchange = field.onchange;
  field.oninput = follow;
  follow();
  return one;
}

const want = () => ask({do: 'particles', on: $('particles').checked});
$('particles').onchange = want;
$('parameters').onsubmit = event => event.preventDefault();
connect();
