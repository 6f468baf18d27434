// The live page: numbers come as server-sent events, previews are fetched when there is a new one. Everything that comes
// from the rig is set as text, never as markup.
'use strict';

const $ = (id) => document.getElementById(id);
const cards = new Map();
const HISTORY = 120;
let recording = false;
let busy = false;
let lastMessage = -1;

// Numbers for people ------------------------------------------------------------------------------------------------

function scaled(value, unit, steps = ['', 'k', 'M', 'G', 'T']) {
  let step = 0;
  while (value >= 999.5 && step < steps.length - 1) { value /= 1000; step += 1; }
  const digits = value >= 100 || step === 0 && Number.isInteger(value) ? 0 : value >= 10 ? 1 : 2;
  return `${value.toFixed(digits)} ${steps[step]}${unit}`;
}

function span(seconds) {
  const s = Math.max(0, Math.floor(seconds));
  const two = (n) => String(n).padStart(2, '0');
  return s >= 3600 ? `${Math.floor(s / 3600)}:${two(Math.floor(s / 60) % 60)}:${two(s % 60)}` : `${Math.floor(s / 60)}:${two(s % 60)}`;
}

function longSpan(seconds) {
  if (seconds > 48 * 3600) return 'days';
  if (seconds > 5400) return `${(seconds / 3600).toFixed(1)} h`;
  return seconds > 90 ? `${Math.round(seconds / 60)} min` : `${Math.round(seconds)} s`;
}

function micro(us) {
  return us >= 1000 ? `${(us / 1000).toFixed(us >= 10000 ? 0 : 1)} ms` : `${us.toFixed(us >= 10 ? 0 : 1)} µs`;
}

function text(node, value) { if (node.textContent !== value) node.textContent = value; }

// Cards -------------------------------------------------------------------------------------------------------------

const STATES = {
  stopped: ['stopped', 'dim'], waiting: ['waiting for data', 'dim'], running: ['live', ''],
  stalled: ['no data', 'warn dim'], lost: ['lost', 'bad dim'],
};

// Whether a recording is played, and no camera is there.
let replayed = false;

// Where a camera is: of this host, whose cards are keyed by the camera alone, or of another one.
const here = { key: (id) => id, base: 'api/', grid: () => $('streams') };

function card(stream, place = here) {
  const key = place.key(stream.id);
  let found = cards.get(key);
  if (found) return found;
  const node = $('card').content.firstElementChild.cloneNode(true);
  text(node.querySelector('h3'), stream.id);
  const model = stream.serial ? `${stream.model} · ${stream.serial}` : stream.model;
  text(node.querySelector('.model'), model);
  node.querySelector('.model').title = model;
  const image = node.querySelector('img');
  image.alt = `preview of ${stream.id}`;
  // The view takes the shape of its picture.
  image.addEventListener('load', () => { node.querySelector('.view').style.aspectRatio = `${image.naturalWidth} / ${image.naturalHeight}`; });
  image.addEventListener('click', () => enlarge(key));
  image.addEventListener('keydown', (event) => { if (event.key === 'Enter') enlarge(key); });
  found = { node, image, id: stream.id, base: place.base, version: 0, loading: false, history: [], rows: new Map(), visible: true };
  new IntersectionObserver((seen) => { found.visible = seen.at(-1).isIntersecting; }).observe(node);
  place.grid().append(node);
  cards.set(key, found);
  return found;
}

function row(found, name, value, bad = false) {
  let dd = found.rows.get(name);
  if (!dd) {
    const list = found.node.querySelector('.rates');
    const dt = document.createElement('dt');
    dd = document.createElement('dd');
    dt.textContent = name;
    list.append(dt, dd);
    found.rows.set(name, dd);
  }
  text(dd, value);
  dd.classList.toggle('bad', bad);
}

function spark(found, value) {
  found.history.push(value);
  if (found.history.length > HISTORY) found.history.shift();
  const canvas = found.node.querySelector('.spark');
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [Math.round((canvas.clientWidth - 28) * ratio), Math.round(36 * ratio)];
  if (width <= 0) return;
  if (canvas.width !== width) { canvas.width = width; canvas.height = height; }
  const context = canvas.getContext('2d');
  context.clearRect(0, 0, width, height);
  const most = Math.max(...found.history, 1e-9);
  const x = (index) => width * (index + HISTORY - found.history.length) / (HISTORY - 1);
  const y = (rate) => height - 2 * ratio - (height - 6 * ratio) * rate / most;
  context.beginPath();
  found.history.forEach((rate, index) => context.lineTo(x(index), y(rate)));
  context.strokeStyle = '#5aa7ff';
  context.lineWidth = 1.5 * ratio;
  context.lineJoin = 'round';
  context.stroke();
  context.lineTo(x(found.history.length - 1), height);
  context.lineTo(x(0), height);
  context.fillStyle = 'rgba(90, 167, 255, .13)';
  context.fill();
}

async function preview(found, version) {
  if (found.loading || !found.visible || document.hidden) return;
  if (version && version === found.version) return;
  found.loading = true;
  try {
    const response = await fetch(`${found.base}preview/${encodeURIComponent(found.id)}`);
    if (response.ok) {
      const url = URL.createObjectURL(await response.blob());
      const old = found.image.src;
      found.image.src = url;
      if (old) URL.revokeObjectURL(old);
      if (version !== null) found.version = version;
    }
  } catch { /* the stream of numbers tells that the recorder is gone */ }
  found.loading = false;
}

// Enlarged cameras ---------------------------------------------------------------------------------------------------

let enlarged = null;
let largeVersion = 0;
let largeLoading = false;

function enlarge(key) {
  const found = cards.get(key);
  if (!found?.pictures) return;
  [enlarged, largeVersion] = [key, -1];
  text($('large-name'), key);
  $('large-image').src = found.image.src;
  $('large-image').alt = `enlarged preview of ${key}`;
  $('large').showModal();
  showLarge(null);
  openKnobs(key);
}

async function showLarge(version) {
  if (!enlarged || largeLoading || document.hidden || version !== null && version === largeVersion) return;
  largeLoading = true;
  const key = enlarged;
  const { base, id } = cards.get(key);
  try {
    const response = await fetch(`${base}preview/${encodeURIComponent(id)}?large=true`);
    if (response.ok && key === enlarged) {
      const url = URL.createObjectURL(await response.blob());
      const image = $('large-image');
      const old = image.dataset.url;
      image.src = image.dataset.url = url;
      if (old) URL.revokeObjectURL(old);
      if (version !== null) largeVersion = version;
    }
  } catch { /* the stream of numbers tells that the recorder is gone */ }
  largeLoading = false;
}

$('large').addEventListener('close', () => { enlarged = null; });
$('large').addEventListener('click', (event) => { if (event.target === $('large') || event.target === $('large-image')) $('large').close(); });
$('large-close').addEventListener('click', () => $('large').close());

// How often a still version is asked for anyway, which keeps the previews being drawn.
const ASK_MS = 1000;
setInterval(() => { cards.forEach((found) => { if (found.pictures) preview(found, null); }); showLarge(null); }, ASK_MS);

function show(stream, look, place = here) {
  const found = card(stream, place);
  const [label, classes] = STATES[stream.state] || [stream.state, ''];
  found.node.className = `card ${classes}`;
  text(found.node.querySelector('.badge'), stream.state === 'running' && replayed ? 'replay' : label);
  found.pictures = stream.encoding !== 'trigger-lines';
  if (found.pictures && look) preview(found, look.version);
  if (place.key(stream.id) === enlarged && look) {
    showLarge(look.version);
    text($('large-figures'), `${stream.width} × ${stream.height} · ${stream.events_per_s == null ? `${stream.packets_per_s.toFixed(1)} /s` : scaled(stream.events_per_s, 'ev/s')}`);
  }
  text(found.node.querySelector('.lines'), look && look.lines.length ? look.lines.join('\n') : '');
  const events = stream.events_per_s;
  spark(found, stream.state === 'running' ? (events ?? stream.packets_per_s) : 0);
  if (events !== null && events !== undefined) {
    const share = stream.decoded_share < 0.95 ? ` (from ${Math.round(100 * stream.decoded_share)} % of the data)` : '';
    row(found, 'events', `${scaled(events, 'ev/s')}${share}`);
  } else if (/^(evt|davis)/.test(stream.encoding)) {
    row(found, 'events', 'not known yet');
  } else if (found.pictures) {
    row(found, 'frames', `${stream.packets_per_s.toFixed(1)} /s`);
  } else {
    row(found, 'messages', `${stream.packets_per_s.toFixed(1)} /s`);
  }
  row(found, 'data', scaled(stream.bytes_per_s, 'B/s'));
  const drops = stream.drops;
  const lost = drops.driver + drops.queue + drops.writer;
  row(found, 'drops', lost ? `driver ${drops.driver} · queue ${drops.queue} · writer ${drops.writer}` : 'none', lost > 0);
  if (stream.clock) {
    const { rate_ppm: ppm, residual_p50_us: p50, residual_p95_us: p95 } = stream.clock;
    row(found, 'clock', `${ppm >= 0 ? '+' : '−'}${Math.abs(ppm).toFixed(1)} ppm · ${micro(p50)} / ${micro(p95)}`);
    found.rows.get('clock').title = stream.clock.basis;
  } else {
    row(found, 'clock', 'not known yet');
  }
  for (const [name, value] of Object.entries(stream.readings)) {
    row(found, name.replaceAll('_', ' '), Number.isInteger(value) ? String(value) : value.toFixed(1));
  }
  const queue = found.node.querySelector('.queue');
  const share = (bytes) => Math.min(100, 100 * bytes / Math.max(1, stream.queue_bytes));
  queue.firstElementChild.style.width = `${share(stream.waiting_bytes)}%`;
  queue.lastElementChild.style.left = `calc(${share(stream.peak_waiting_bytes)}% - 1px)`;
  queue.classList.toggle('full', share(stream.waiting_bytes) > 80);
}

// What a calibration beside the recording has to say: tinted cells, marked corners, figures, advice.
function guide(found, told) {
  const canvas = found.node.querySelector('.guide');
  const advice = found.node.querySelector('.advice');
  canvas.hidden = advice.hidden = !told;
  if (!told) return;
  text(advice, told.advice);
  advice.classList.toggle('done', told.done);
  told.figures.forEach(([name, value]) => row(found, name, value));
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
  if (width <= 0) return;
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  const context = canvas.getContext('2d');
  context.clearRect(0, 0, width, height);
  // The image keeps its shape within the view.
  const { naturalWidth, naturalHeight } = found.image;
  if (!naturalWidth) return;
  const scale = Math.min(width / naturalWidth, height / naturalHeight);
  const [w, h] = [naturalWidth * scale, naturalHeight * scale];
  const [left, top] = [(width - w) / 2, (height - h) / 2];
  const rows = Math.max(1, Math.round(told.coverage.length / Math.max(1, told.columns)));
  told.coverage.forEach((count, at) => {
    if (!count) return;
    context.fillStyle = `rgba(95, 211, 141, ${0.12 + 0.06 * Math.min(count, 4)})`;
    const [column, line] = [at % told.columns, Math.floor(at / told.columns)];
    context.fillRect(left + w * column / told.columns + 1, top + h * line / rows + 1, w / told.columns - 2, h / rows - 2);
  });
  context.fillStyle = '#ffd68a';
  told.points.forEach(([x, y]) => {
    context.beginPath();
    context.arc(left + w * x, top + h * y, 2 * ratio, 0, 2 * Math.PI);
    context.fill();
  });
}

// The whole ---------------------------------------------------------------------------------------------------------

function showAll(status, looks, guidance, place = here) {
  const byId = new Map(looks.map((look) => [look.id, look]));
  const told = new Map(guidance.map((of) => [of.id, of]));
  status.streams.forEach((stream) => {
    show(stream, byId.get(stream.id), place);
    guide(card(stream, place), told.get(stream.id));
  });
}

// Other hosts that record with this one: a heading and their cameras each.
const places = new Map();
function placeOf(host, index) {
  let place = places.get(host.name);
  if (place) return place;
  const node = $('host').content.firstElementChild.cloneNode(true);
  text(node.querySelector('h2'), host.name);
  const link = node.querySelector('a');
  link.href = host.page;
  $('hosts').append(node);
  place = { key: (id) => `${host.name} ${id}`, base: `api/hosts/${index}/`, grid: () => node.querySelector('.streams'), node };
  places.set(host.name, place);
  return place;
}

function taken(recording) {
  const files = recording.files > 1 ? ` in ${recording.files} files` : '';
  return `${span(recording.seconds)} · ${scaled(recording.bytes, 'B')}${files}`;
}

function showHost(host, index) {
  const place = placeOf(host, index);
  const { status } = host;
  place.node.classList.toggle('lost', host.lost !== null);
  place.node.classList.toggle('recording', host.lost === null && Boolean(status?.recording));
  const left = status?.disk.seconds_left;
  const disk = status ? ` · disk ${scaled(status.disk.free, 'B')}${left == null ? '' : `, ${longSpan(left)}`}` : '';
  const doing = !status ? 'not heard of yet'
    : status.recording ? taken(status.recording)
      : status.finishing ? 'writing what waits' : 'not recording';
  text(place.node.querySelector('.rig'), status ? status.rig : '');
  text(place.node.querySelector('.doing'), host.lost !== null ? 'lost' : doing + disk);
  text(place.node.querySelector('.why'), host.lost ?? '');
  if (status) showAll(status, host.looks, host.guidance, place);
}

function update({ status, looks, guidance, folder, span_us: pastUs, playback: played, hosts }) {
  document.body.classList.remove('offline');
  replayed = status.replay;
  text($('rig'), status.rig);
  hosts.forEach(showHost);
  text($('own'), hosts.length ? 'this host' : '');
  const heard = [status, ...hosts.filter((host) => host.lost === null && host.status).map((host) => host.status)];
  const streams = heard.flatMap((of) => of.streams);
  const lostHosts = hosts.length + 1 - heard.length;
  const of = hosts.length ? ` of ${heard.length} hosts` : '';
  text($('link'), `${streams.length} ${streams.length === 1 ? 'stream' : 'streams'}${of}, ${replayed ? 'replay' : 'live'}${lostHosts ? `, ${lostHosts} lost` : ''}`);
  $('link').classList.toggle('bad', lostHosts > 0);
  document.title = `${status.recording ? '● ' : ''}${status.rig} – erfgs ${replayed ? 'replay' : 'live'}`;
  const sum = (of) => streams.reduce((total, stream) => total + of(stream), 0);
  text($('rate'), scaled(sum((stream) => stream.bytes_per_s), 'B/s'));
  text($('events'), scaled(sum((stream) => stream.events_per_s ?? 0), 'ev/s'));
  const lost = sum((stream) => stream.drops.driver + stream.drops.queue + stream.drops.writer);
  text($('dropped'), lost ? `${lost} packets` : 'none');
  $('dropped').classList.toggle('bad', lost > 0);
  // The one that is full first.
  const lasts = (disk) => disk.seconds_left ?? Infinity;
  const disk = heard.map((host) => host.disk).reduce((least, disk) => lasts(disk) < lasts(least) ? disk : least);
  text($('disk'), scaled(disk.free, 'B'));
  const left = disk.seconds_left;
  if (left !== null && left !== undefined) {
    const small = document.createElement('small');
    small.textContent = ` ${longSpan(left)}`;
    $('disk').append(small);
  }
  $('disk').classList.toggle('bad', left !== null && left !== undefined && left < 60);
  recording = status.recording !== null;
  const finishing = status.finishing !== null;
  document.body.classList.toggle('recording', recording);
  $('take').classList.toggle('stops', recording);
  text($('state'), recording
    ? taken(status.recording)
    : finishing ? 'writing what waits'
      : status.held ? `holding ${status.held.seconds.toFixed(1)} of ${status.held.of_seconds} s · ${scaled(status.held.bytes, 'B')}` : 'not recording');
  $('keep').hidden = !status.held;
  $('keep').disabled = busy || finishing;
  if (status.held) text($('keep'), `Keep the last ${status.held.of_seconds} s`);
  $('tally').title = recording ? status.recording.path : '';
  text($('button'), recording ? 'Stop recording' : 'Start recording');
  $('button').disabled = busy || finishing;
  text($('folder'), `in ${folder}`);
  showAll(status, looks, guidance);
  $('tools').hidden = !streams.some((stream) => stream.events_per_s != null || /^(evt|davis|aedat)/.test(stream.encoding));
  if (document.activeElement !== $('span')) $('span').value = String(pastUs);
  playback(played);
  warnings(status.unread);
  messages(status);
}

$('span').addEventListener('change', () => {
  const body = JSON.stringify({ us: Number($('span').value) });
  const bases = ['api/', ...[...places.values()].map((place) => place.base)];
  bases.forEach((base) => fetch(`${base}span`, { method: 'POST', headers: { 'content-type': 'application/json' }, body }).catch(() => {}));
  $('span').blur();
});

// Warnings stay until somebody says that they were read, on this page or another.
let warned = '';
function warnings(unread) {
  const key = unread.map((message) => message.number).join();
  $('warnings').hidden = !unread.length;
  if (key === warned) return;
  warned = key;
  $('warnings').replaceChildren(...unread.slice().reverse().map((message) => {
    const item = document.createElement('li');
    item.className = message.level;
    const what = document.createElement('p');
    if (message.stream) {
      const who = document.createElement('b');
      who.textContent = `${message.stream} `;
      what.append(who);
    }
    what.append(message.text);
    const read = document.createElement('button');
    read.type = 'button';
    read.className = 'plain';
    read.textContent = 'Read';
    read.addEventListener('click', () => {
      item.remove();
      fetch('api/read', { method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify({ number: message.number }) }).catch(() => {});
    });
    item.append(what, read);
    return item;
  }));
}

function messages(status) {
  const newest = status.messages.at(-1)?.number ?? 0;
  if (newest === lastMessage) return;
  lastMessage = newest;
  list();
  const items = status.messages.slice().reverse().map((message) => {
    const item = document.createElement('li');
    item.className = message.level;
    const when = document.createElement('span');
    when.className = 'quiet';
    const ago = (status.host_ns - message.host_ns) / 1e6;
    when.textContent = new Date(Date.now() - ago).toLocaleTimeString('en-GB');
    const what = document.createElement('span');
    if (message.stream) {
      const who = document.createElement('b');
      who.textContent = `${message.stream} `;
      what.append(who);
    }
    what.append(message.text);
    item.append(when, what);
    return item;
  });
  if (items.length) $('messages').replaceChildren(...items);
}

async function list() {
  try {
    const response = await fetch('api/recordings');
    if (!response.ok) return;
    const items = (await response.json()).map(({ name, bytes }) => {
      const item = document.createElement('li');
      const link = document.createElement('a');
      link.href = `recordings/${encodeURIComponent(name)}`;
      link.textContent = name;
      const size = document.createElement('span');
      size.className = 'quiet';
      size.textContent = scaled(bytes, 'B');
      item.append(link, size);
      return item;
    });
    if (items.length) $('recordings').replaceChildren(...items);
  } catch { /* tried again with the next message */ }
}
setInterval(list, 10000);

async function ask(path, body) {
  if (busy) return;
  busy = true;
  $('button').disabled = $('keep').disabled = true;
  text($('answer'), '');
  try {
    const response = await fetch(path, {
      method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(body),
    });
    const answer = await response.json();
    if (!response.ok) text($('answer'), answer.error);
    else if (answer.failure) text($('answer'), answer.failure);
    else $('name').value = '';
  } catch {
    text($('answer'), 'the recorder does not answer');
  }
  busy = false;
  list();
}

$('take').addEventListener('submit', (event) => {
  event.preventDefault();
  if (recording) ask('api/stop', {}); else ask('api/start', { name: $('name').value });
});
$('keep').addEventListener('click', () => ask('api/keep', {}));

// The other script is there by then.
document.addEventListener('DOMContentLoaded', () => {
  const source = new EventSource('api/stream');
  source.onmessage = (event) => update(JSON.parse(event.data));
  source.onerror = () => {
    document.body.classList.add('offline');
    text($('link'), 'connection lost: trying again');
  };
});
