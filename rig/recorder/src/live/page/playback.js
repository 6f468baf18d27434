// A recording that is played: pause, seek, step, speed. Nothing of it shows where cameras are there.
'use strict';

const MS = 1e6;
let playing = null;
// While the slider is held, or an answer is awaited, the numbers that come do not move it.
let held = 0;
let sought = null;

async function order(what) {
  try {
    const response = await fetch('api/playback', {
      method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(what),
    });
    const answer = await response.json();
    if (response.ok) playback(answer); else text($('answer'), answer.error);
  } catch {
    text($('answer'), 'the playback does not answer');
  }
}

// The slider asks for the latest place only.
let asking = false;
async function seek(ns) {
  sought = ns;
  if (asking) return;
  asking = true;
  while (sought !== null) {
    const to = sought;
    sought = null;
    await order({ seek: to });
  }
  asking = false;
}

function clockTime(ns, digits = 3) {
  const seconds = ns / 1e9;
  const minutes = Math.floor(seconds / 60);
  return `${minutes}:${(seconds - 60 * minutes).toFixed(digits).padStart(digits + 3, '0')}`;
}

function playback(now) {
  playing = now;
  $('player').hidden = !now;
  if (!now) return;
  const rests = now.paused || now.finished;
  text($('play'), rests ? 'Play' : 'Pause');
  $('play').setAttribute('aria-pressed', String(!rests));
  $('player').querySelectorAll('[data-frame]').forEach((button) => { button.hidden = !now.cameras.length; });
  const slider = $('seek');
  slider.max = String(now.length_ns / 1000);
  if (Date.now() > held) slider.value = String(now.position_ns / 1000);
  slider.style.setProperty('--share', `${100 * Number(slider.value) / Math.max(1, Number(slider.max))}%`);
  const at = Date.now() > held ? now.position_ns : Number(slider.value) * 1000;
  text($('position'), clockTime(at));
  text($('length'), `/ ${clockTime(now.length_ns)}${now.repeat ? ', again and again' : ''}`);
  $('position').title = now.epoch_ns > 0 ? new Date((now.epoch_ns + at) / 1e6).toISOString() : '';
  const speed = now.speed === null ? 'max' : String(now.speed);
  const choice = $('speed');
  if (document.activeElement !== choice) {
    if (![...choice.options].some((option) => option.value === speed)) {
      const option = new Option(speed === 'max' ? 'as fast as it goes' : `${speed} ×`, speed);
      option.disabled = speed === 'max';
      choice.append(option);
    }
    choice.value = speed;
  }
}

function step(ns) { if (playing) order({ step: Math.round(ns) }); }
function stepFrame(back) {
  if (!playing || !playing.cameras.length) return;
  const camera = playing.cameras.includes(enlarged) ? enlarged : '';
  order(back ? { 'frame-back': camera } : { frame: camera });
}
function toggle() { if (playing) order(playing.paused || playing.finished ? 'play' : 'pause'); }

$('play').addEventListener('click', toggle);
$('player').querySelectorAll('[data-step]').forEach((button) => {
  button.addEventListener('click', () => step(Number(button.dataset.step) * MS));
});
$('player').querySelectorAll('[data-frame]').forEach((button) => {
  button.addEventListener('click', () => stepFrame(button.dataset.frame === 'back'));
});
$('seek').addEventListener('input', () => { held = Date.now() + 700; seek(Math.round(Number($('seek').value) * 1000)); });
$('speed').addEventListener('change', () => { order({ speed: Number($('speed').value) }); $('speed').blur(); });

document.addEventListener('keydown', (event) => {
  if (!playing || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target instanceof Element && event.target.closest('input, select, textarea, button, summary, a')) return;
  const keys = {
    ' ': toggle, ArrowRight: () => step(MS), ArrowLeft: () => step(-MS), '.': () => stepFrame(false), ',': () => stepFrame(true),
  };
  const act = keys[event.key];
  if (!act) return;
  event.preventDefault();
  act();
});
