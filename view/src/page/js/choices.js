// What can be chosen where bodies are there, and only there: bodies in colours, and one of them alone.

export function offerBodies(look, layer, scenes) {
  const names = [...new Set(scenes.flatMap(({ motion }) => motion.names ?? []))];
  const offered = JSON.stringify(names);
  if ((look.dataset.bodies ?? '[]') === offered) return;
  look.dataset.bodies = offered;
  offer(look, names.length > 0 ? [['bodies in colours', 'bodies']] : []);
  offer(layer, names.map((name) => [`${name} alone`, `body:${name}`]));
}

// Has these options, text and value, behind those that are always there.
function offer(select, options) {
  const chosen = select.value;
  select.querySelectorAll('.body').forEach((option) => option.remove());
  for (const [text, value] of options) select.add(Object.assign(new Option(text, value), { className: 'body' }));
  select.value = chosen;
  if (select.selectedIndex < 0) select.selectedIndex = 0;
}
