// What a scene file says of itself, and whether that can be.

import { CUT_OFF, DAMAGED, FOREIGN, isCount, need, sizeOf } from './codings.js';
import { pathFloats } from './trajectory.js';

// Numbers of a row of harmonics, by their degree.
export const SH_STRIDE = [4, 12, 28, 48];

// A header that fits itself and `size` bytes of sections.
export function checked(header, size) {
  const { count, dynamic, sh_degree: degree, active_sh_degree: active, motion, cameras, sections, coarse = [], near, span_ns: span, events } = header;
  need(isCount(count) && isCount(dynamic) && dynamic <= count && isCount(active) && active <= degree && degree in SH_STRIDE);
  need(['still', 'free-time', 'bodies', 'hexplane'].includes(motion.kind), FOREIGN);
  const numbers = (list, length) => need(list.length === length && list.every(Number.isFinite));
  numbers(near, 2);
  numbers(span, 2);
  numbers(header.background, 3);
  need(cameras.length > 0 && events.counts.every((_, bin) => Number.isFinite(events.edges[bin + 1])));
  for (const { rotation, translation, width, height, fx, fy, cx, cy, frames } of cameras) {
    numbers([...rotation.flat(), ...translation, width, height, fx, fy, cx, cy], 18);
    for (const frame of frames) numbers(frame, 3);
  }
  let bytes = 0;
  for (const { floats, coding, at = 0 } of sections) {
    need(isCount(floats) && isCount(at));
    bytes += sizeOf(coding, floats);
  }
  need(bytes === size, bytes > size ? CUT_OFF : DAMAGED);
  // The pieces of a section lie one behind the other and leave nothing out.
  const lengths = new Map();
  for (const { name, floats, at = 0 } of sections.toSorted((a, b) => (a.at ?? 0) - (b.at ?? 0))) {
    need((lengths.get(name) ?? 0) === at);
    lengths.set(name, at + floats);
  }
  need(lengths.get('core') === 12 * count && lengths.get('sh') === SH_STRIDE[degree] * count && lengths.has('points'));
  if (motion.kind === 'free-time' || motion.kind === 'bodies') need(lengths.get('motion') === pathFloats(motion) * dynamic);
  if (motion.kind === 'bodies') {
    const { names, nodes, control, seconds, softness } = motion;
    need(names.length > 0 && names.every((name) => typeof name === 'string') && isCount(nodes) && isCount(control) && control >= 4);
    numbers([seconds, softness], 2);
    need(seconds > 0 && softness > 0);
    const carriers = names.length + nodes;
    need(lengths.get('hangs') === 5 * dynamic && lengths.get('bodies.control') === 8 * control * carriers && lengths.get('bodies.other') === 4 * carriers);
  }
  if (motion.kind === 'hexplane') need(lengths.get('grid.level0.xt') > 0 && lengths.has('trunk.0.weight'));
  const still = count - dynamic;
  for (const part of coarse) need(isCount(part.sections) && isCount(part.dynamic) && part.dynamic <= dynamic && isCount(part.still) && part.still <= still);
  return header;
}
