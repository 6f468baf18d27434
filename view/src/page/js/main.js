// The page: what is shown, from where, and when.

import * as source from './source.js';
import { Models } from './models.js';
import { Take } from './take.js';
import { Training } from './training.js';
import { FreeCamera, overview, preset } from './camera.js';
import { listen } from './controls.js';
import { Timeline } from './timeline.js';
import { arrows } from './arrows.js';
import { Overlay } from './overlay.js';
import { offerBodies } from './choices.js';
import { Recorded } from './recorded.js';
import { CameraPath } from './path.js';
import { save, savePicture } from './save.js';
import { check } from './check.js';

const $ = (id) => document.getElementById(id);
const options = new URLSearchParams(location.search);
// A picture has no more pixels than fit the bindings that WebGPU guarantees (128 MiB for 16 bytes each), on a side no more than its
// textures have.
const MOST_PIXELS = 3840 * 2160;
const LONGEST_SIDE = 8192;
// Slower than this, pictures become coarser while something moves.
const SLOW_MS = 50;

function trouble(message) {
  $('trouble').textContent = message;
  $('trouble').hidden = !message;
}

function loading(share) {
  $('loading').value = share;
  $('loading').hidden = share >= 1;
}

async function start() {
  const abouts = await source.models();
  const take = new Take(abouts);
  const called = take.long ? abouts[0].window.take : abouts[0].name;
  $('title').textContent = take.long ? called : abouts.map((about) => about.name).join(' | ');
  document.title = `${$('title').textContent} - erfgs view`;
  const link = new URLSearchParams(location.hash.slice(1));
  const begin = take.at(take.long && link.has('t') ? Number(link.get('t')) / take.seconds || 0 : 0);
  const canvases = take.long ? abouts.map(() => $('picture0')) : [0, 1].map((k) => $(`picture${k}`));
  const state = { t01: 0, camera: null, playing: false, changed: true, coarse: 1, drawn: 0, walk: null, lost: false };
  const changed = () => { state.changed = true; };
  const models = await Models.load(abouts, canvases, options.get('renderer'), take.long ? [begin.model] : [...abouts.keys()], loading, changed);
  const header = take.header(models.list[begin.model].scene.header);
  // What is seen at an instant: runs beside each other, or a window of a take; with the instant on its own line of time.
  const seenAt = (t01) => {
    const now = take.at(t01);
    const shown = (take.long ? [now.model] : [...abouts.keys()]).map((k) => models.want(k));
    return { ...now, shown: shown.every(Boolean) ? shown : [] };
  };
  const followDevice = async () => {
    const lost = await models.gpu?.device.lost;
    if (!lost) return;
    state.lost = true;
    const what = `The graphics device was lost (${lost.message || lost.reason}).`;
    trouble(`${what} It is being taken up again.`);
    try {
      if (!await models.recover()) throw new Error('It does not stay');
      state.lost = false;
      trouble('');
      changed();
      followDevice();
    } catch (error) {
      trouble(`${what} ${error.message}: load the page again, which keeps time and place.`);
    }
  };
  followDevice();

  const seconds = (header.span_ns[1] - header.span_ns[0]) / 1e9;
  const free = new FreeCamera(overview(header.cameras));
  for (const camera of header.cameras) $('camera').append(new Option(`${camera.name} (${camera.modality}, ${camera.split})`, camera.name));
  $('time').max = seconds;
  $('time').step = 0.001;
  const named = (name) => header.cameras.find((camera) => camera.name === name) ?? null;
  const choose = (camera) => {
    if (!camera && state.camera) free.from(state.camera);
    Object.assign(state, { camera, walk: null });
    $('camera').value = camera?.name ?? '';
    timeline.measured(errors, camera?.name);
    changed();
  };
  const at = (t01) => { state.t01 = Math.min(1, Math.max(0, t01)); changed(); };
  // Of two runs on one recording, one may know its events.
  const known = take.long ? header : models.list.find(({ scene }) => scene.header.events.counts.length > 0)?.scene.header ?? header;
  const timeline = new Timeline($('timeline'), known, (t01) => { play(false); at(t01); });
  const errors = abouts[0].from_run ? take.errors(await Promise.all(abouts.map(async (_, k) => (await fetch(`api/errors/${k}`)).json()))) : [];
  timeline.measured(errors);
  const overlay = new Overlay($('overlay'));
  const recorded = new Recorded($('recorded'), changed);
  const path = new CameraPath();
  const controls = listen($('stage'), () => { choose(null); return free; }, changed);

  // What a link holds.
  if (link.has('t')) at(Number(link.get('t')) / seconds || 0);
  if (!free.read(link.get('free') ?? '')) choose(named(link.get('camera')) ?? header.cameras.find((camera) => camera.split === 'test') ?? header.cameras[0]);
  const remember = () => {
    // Within another page, there is no address of its own.
    if (location.protocol === 'about:') return;
    const place = state.camera ? { camera: state.camera.name } : { free: free.text() };
    history.replaceState(null, '', `#${new URLSearchParams({ t: (state.t01 * seconds).toFixed(4), ...place })}`);
  };

  function play(on) {
    state.playing = on;
    $('play').textContent = on ? 'Stop' : 'Play';
    if (!on) changed();
  }
  $('play').addEventListener('click', () => play(!state.playing));
  $('time').addEventListener('change', () => { play(false); at(Number($('time').value) / seconds); });
  $('camera').addEventListener('change', () => choose(named($('camera').value)));
  const how = () => ({ mode: $('mode').value, look: $('look').value, layer: $('layer').value });
  for (const id of ['mode', 'look', 'layer', 'cameras', 'velocities', 'events', 'recordedmode', 'opacity', 'split']) $(id).addEventListener('input', changed);
  for (const kind of ['pointerdown', 'pointermove']) $('split').addEventListener(kind, (event) => event.stopPropagation());
  $('help').addEventListener('click', () => { $('keys').hidden = !$('keys').hidden; $('help').setAttribute('aria-expanded', String(!$('keys').hidden)); changed(); });
  const stem = () => `${called}-${(state.t01 * seconds).toFixed(4)}s`;
  $('shot').addEventListener('click', () => {
    const { shown, t01 } = seenAt(state.t01);
    if (shown.length) savePicture(`${stem()}.png`, shown.map(({ painter }) => painter), view(), t01, how(), Number($('split').value)).then(changed);
  });
  const keysChanged = () => {
    const count = path.keys.length;
    $('keyframes').textContent = count === 1 ? '1 key frame' : `${count} key frames`;
    for (const id of ['walk', 'savepath']) $(id).disabled = count < 2;
    $('nopath').disabled = count === 0;
  };
  const addKey = () => { path.add(view(), state.t01); keysChanged(); };
  const walk = (on) => {
    state.walk = on ? 0 : null;
    $('walk').textContent = on ? 'Stop' : 'Walk it';
    changed();
  };
  $('addkey').addEventListener('click', addKey);
  $('walk').addEventListener('click', () => { play(false); walk(state.walk === null); });
  $('savepath').addEventListener('click', () => save(`${called}-path.json`, new Blob([path.file(seconds)], { type: 'application/json' })));
  $('nopath').addEventListener('click', () => { walk(false); path.clear(); keysChanged(); });
  // The window, its zoom, or what stands beside the picture in it.
  addEventListener('resize', changed);
  new ResizeObserver(changed).observe($('stage'));
  const frames = timeline.exposures.map(([t]) => t);
  const keys = {
    ' ': () => play(!state.playing),
    ArrowLeft: () => { play(false); at(frames.findLast((t) => t < state.t01 - 1e-6) ?? 0); },
    ArrowRight: () => { play(false); at(frames.find((t) => t > state.t01 + 1e-6) ?? 1); },
    ',': () => { play(false); at(state.t01 - 1e-3 / seconds); },
    '.': () => { play(false); at(state.t01 + 1e-3 / seconds); },
    '[': () => { timeline.range = [state.t01, timeline.range[1] > state.t01 ? timeline.range[1] : 1]; changed(); },
    ']': () => { timeline.range = timeline.range[0] < state.t01 ? [timeline.range[0], state.t01] : [0, 1]; changed(); },
    c: () => step(1), C: () => step(-1), k: addKey,
  };
  const step = (by) => {
    const index = header.cameras.indexOf(state.camera);
    choose(header.cameras.at((index + by) % header.cameras.length));
  };
  addEventListener('keydown', (event) => {
    if (controls.typing(event) || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  const second = abouts.length > 1 && !take.long;
  for (const id of ['picture1', 'split']) $(id).hidden = !second;

  // The picture that fits the stage, and its size on the page.
  const view = () => {
    const room = [$('stage').clientWidth, $('stage').clientHeight].map((side) => Math.max(16, side));
    const most = Math.min(Math.sqrt(MOST_PIXELS / (room[0] * room[1])), LONGEST_SIDE / Math.max(...room));
    const ratio = Math.min(devicePixelRatio || 1, most) / state.coarse;
    const size = room.map((side) => Math.max(16, Math.round(side * ratio)));
    const seen = state.walk !== null ? free.along(path.at(state.walk), size)
      : state.camera ? { ...preset(state.camera, size), near: nearOf(state.camera) } : free.view(size);
    const shown = $('frame').style;
    [shown.width, shown.height] = [`${seen.width / ratio}px`, `${seen.height / ratio}px`];
    return seen;
  };

  // The near plane of a camera, as the window that is seen has it.
  const nearOf = ({ name, near }) => {
    const own = models.list[take.at(state.t01).model]?.scene.header.cameras.find((camera) => camera.name === name);
    return own?.near ?? near;
  };

  // What was recorded, and what is drawn over the picture of a scene.
  const showMore = (seen, scene, now) => {
    const camera = state.walk === null ? state.camera : null;
    const has = Boolean(camera?.frames.length) && abouts[0].from_run;
    $('recordedlabel').hidden = !has;
    const kind = has ? $('recordedmode').value : '';
    $('opacity').hidden = kind !== 'over';
    recorded.frame(camera, state.t01, kind, $('opacity').value);
    overlay.begin(seen);
    const hasEvents = Boolean(camera) && camera.modality !== 'rgb' && abouts[0].from_run;
    $('eventslabel').hidden = !hasEvents;
    if (hasEvents && $('events').value) {
      // Milliseconds, about the instant that is shown.
      const [start, end] = scene.header.span_ns;
      const half = Number($('events').value) * 5e5 / Math.max(1, end - start);
      const packed = recorded.events(now.model, camera, now.t01 - half, now.t01 + half);
      if (packed) overlay.events(packed, camera);
    }
    if ($('cameras').checked) overlay.cameras(header.cameras, camera);
    $('velocitieslabel').hidden = !arrows(scene.motion);
    if ($('velocities').checked && arrows(scene.motion)) overlay.velocities(scene, now.t01);
  };

  let last = performance.now();
  let busy = false;
  let idle = 0;
  async function tick(now) {
    requestAnimationFrame(tick);
    const elapsed = Math.min(0.25, (now - last) / 1000);
    last = now;
    if (state.playing) {
      const [from, to] = timeline.range;
      const next = state.t01 + elapsed * Number($('speed').value) / Math.max(1e-9, seconds);
      at(next >= to || next < from ? from : next);
    }
    if (state.walk !== null) {
      state.walk = (state.walk + elapsed) % path.seconds;
      at(path.at(state.walk).t01);
    }
    controls.fly(elapsed);
    if (busy || state.lost) return;
    if (!state.changed) {
      // At rest, what was drawn coarsely while it moved is drawn as finely as the screen is.
      idle += 1;
      if (idle === 12 && state.coarse > 1) { state.coarse = 1; state.changed = true; }
      if (idle === 20) remember();
      if (!state.changed) return;
    } else idle = 0;
    busy = true;
    document.body.dataset.busy = 'yes';
    state.changed = false;
    try {
      const from = performance.now();
      timeline.draw(state.t01);
      if (document.activeElement !== $('time')) $('time').value = (state.t01 * seconds).toFixed(3);
      const { shown, ...now } = seenAt(state.t01);
      const next = take.after(now.number);
      if (next !== undefined && shown[0]?.scene.whole) models.want(next);
      if (shown.length === 0) {
        // Until the window is there, the last picture stays; what comes then asks for another.
        $('note').textContent = `window ${now.number + 1} of ${abouts.length} is being loaded`;
        return;
      }
      offerBodies($('look'), $('layer'), shown.map(({ scene }) => scene));
      const seen = view();
      showMore(seen, shown[0].scene, now);
      $('picture1').style.clipPath = `inset(0 0 0 ${100 * Number($('split').value)}%)`;
      // While they are drawn, better ones may come.
      for (const { painter } of shown) if (await painter.draw(seen, now.t01, how())) state.changed = true;
      const took = performance.now() - from;
      if ((state.playing || state.walk !== null || idle === 0) && took > SLOW_MS && state.coarse < 4) state.coarse *= 2;
      state.drawn += 1;
      for (const id of ['mode', 'look', 'layer']) $(id).disabled = Boolean(models.why);
      const drawnBy = models.why ? `drawn by the server (${models.why})` : `${took.toFixed(0)} ms`;
      const [{ scene: { header: { count, dynamic }, count: there } }] = shown;
      const whole = shown.every(({ scene }) => scene.whole);
      const some = shown[0].scene.whole || models.why ? '' : `${there.toLocaleString('en')} of `;
      const which = take.long ? `window ${now.number + 1} of ${abouts.length} · ` : '';
      document.body.dataset.window = now.number;
      $('note').textContent = `${which}${some}${count.toLocaleString('en')} Gaussians, ${dynamic.toLocaleString('en')} move · ${seen.width} x ${seen.height} · ${drawnBy}`;
      document.body.dataset.shown = whole ? 'all' : 'some';
      if (state.failed) trouble('');
      state.failed = false;
      document.body.dataset.drawn = state.drawn;
    } catch (error) {
      // What a lost device says of a picture is told by who takes it up again.
      state.failed = !state.lost;
      if (state.failed) trouble(error.message);
    } finally {
      busy = false;
      delete document.body.dataset.busy;
    }
  }
  if (options.has('check')) {
    await models.whole;
    $('note').textContent = 'comparing with the server';
    for (const k of abouts.keys()) {
      const { painter, scene } = await models.all(k);
      await check(painter, k, scene.header, Number(options.get('check')) || 5, ({ camera, mode, psnr_db, worst }) => {
        $('note').textContent = `${camera}, ${mode}: ${psnr_db.toFixed(1)} dB against the server, ${worst} of 255 at most`;
      });
    }
    document.body.dataset.checked = 'yes';
    return;
  }
  requestAnimationFrame(tick);
  // What is seen by then goes on being seen.
  await models.whole;
  changed();
  if (abouts[0].training) {
    new Training($('training'), async () => {
      // The scene's size is told anew with it.
      Object.assign(abouts[0], (await source.models())[0]);
      await models.renew(0);
      changed();
    }).follow();
  }
}

start().catch((error) => {
  loading(1);
  $('note').textContent = '';
  trouble(error.message);
});
