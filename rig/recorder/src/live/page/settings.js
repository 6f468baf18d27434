// What of an enlarged camera can be changed while it runs: biases, regions, rates, filters.
'use strict';

let knobs = [];
const drawn = (name, properties = {}) => Object.assign(document.createElement(name), properties);

async function post(path, body) {
  const response = await fetch(path, {
    method: 'POST', headers: { 'content-type': 'application/json' }, body: JSON.stringify(body),
  });
  const answer = await response.json();
  if (!response.ok) throw new Error(answer.error);
  return answer;
}

// The fields of a knob, as inputs that say where their value lies.
function fields(knob) {
  const [kind, of] = typeof knob.kind === 'string' ? [knob.kind, {}] : Object.entries(knob.kind)[0];
  if (kind === 'number') {
    const input = drawn('input', { type: 'number', min: of.least, max: of.most, step: of.step, placeholder: knob.off ? 'off' : '' });
    input.value = knob.value ?? '';
    input.title = `${of.least} to ${of.most}${knob.off ? ', or empty' : ''}`;
    return [input];
  }
  if (kind === 'choice') {
    const select = drawn('select');
    select.append(new Option('off', ''), ...of.choices.map((choice) => new Option(choice, choice)));
    select.value = knob.value ?? '';
    return [select];
  }
  return ['x', 'y', 'width', 'height'].map((side) => {
    const most = side === 'x' || side === 'width' ? of.columns : of.rows;
    const input = drawn('input', { type: 'number', min: 0, max: most, step: 1, placeholder: side, title: `${side}, pixels; empty for all of the sensor` });
    input.value = knob.value ? knob.value[side] : '';
    input.dataset.side = side;
    return input;
  });
}

function value(knob) {
  const inputs = knob.inputs;
  const kind = Object.keys(knob.kind)[0];
  if (kind === 'choice') return inputs[0].value || null;
  if (kind === 'number') return inputs[0].value === '' ? null : Number(inputs[0].value);
  if (inputs.every((input) => input.value === '')) return null;
  const window = Object.fromEntries(inputs.map((input) => [input.dataset.side, Number(input.value)]));
  return knob.kind.window.list ? [window] : window;
}

function put(into, path, what) {
  const names = path.split('.');
  const last = names.pop();
  for (const name of names) into = into[name] ??= {};
  into[last] = what;
}

// What differs from how it stands. Settings that are off together are sent together.
function changes() {
  const changed = {};
  const touched = knobs.filter((knob) => JSON.stringify(value(knob)) !== knob.before);
  for (const knob of touched) {
    const group = knob.off ? knobs.filter((other) => other.off === knob.off) : [knob];
    const values = group.map((other) => [other, value(other)]).filter(([, what]) => what !== null);
    if (knob.off && (!values.length || value(knob) === null && group.length === 1)) put(changed, knob.off, null);
    else values.forEach(([other, what]) => put(changed, other.path, what));
  }
  return changed;
}

function showKnobs(found) {
  knobs = found;
  $('knobs').hidden = !found.length;
  $('knob-fields').replaceChildren(...found.map((knob) => {
    knob.inputs = fields(knob);
    knob.before = JSON.stringify(value(knob));
    const label = drawn('label');
    label.append(drawn('span', { textContent: knob.label }), ...knob.inputs);
    label.dataset.path = knob.path;
    return label;
  }));
}

async function openKnobs(key) {
  const { base, id } = cards.get(key);
  showKnobs([]);
  text($('knob-answer'), '');
  const response = await fetch(`${base}knobs/${encodeURIComponent(id)}`);
  if (response.ok && key === enlarged) showKnobs(await response.json());
}

$('knobs').addEventListener('submit', async (event) => {
  event.preventDefault();
  const changed = changes();
  if (!Object.keys(changed).length) { text($('knob-answer'), 'nothing was changed'); return; }
  text($('knob-answer'), 'changing');
  const { base, id } = cards.get(enlarged);
  try {
    showKnobs(await post(`${base}adjust`, { stream: id, changed }));
    text($('knob-answer'), 'changed, and noted in the recording');
  } catch (error) { text($('knob-answer'), error.message); }
});
$('knob-keep').addEventListener('click', async () => {
  try {
    const { base, id } = cards.get(enlarged);
    await post(`${base}keep-settings`, { stream: id });
    text($('knob-answer'), 'written into the rig’s file');
  } catch (error) { text($('knob-answer'), error.message); }
});
