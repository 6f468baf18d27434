// Where what moves is going: for each Gaussian that is there, two places a little while apart.

import { moved } from './trajectory.js';
import { placeOf, posesAt } from './carried.js';

// How long an arrow is, RGB intervals.
const AHEAD = 0.25;
// What is fainter has none.
const FAINT = 0.1;

export const arrows = ({ kind }) => kind === 'free-time' || kind === 'bodies';

const opacityOf = (scene, k) => 1 / (1 + Math.exp(-scene.core[12 * k + 10]));

// Of those that are free in time.
export function freeRows(scene, t01) {
  const { motion, rows, core, dynamic, hangs } = scene;
  const { intervals, least_life: least } = motion;
  const seen = [];
  for (let k = 0; k < dynamic; k++) {
    if (hangs?.[5 * k] > 0) continue;
    const row = scene.rowFloats * k;
    const dt = t01 * intervals - rows[row + 3];
    const life = least + Math.exp(Math.min(30, rows[row + 7]));
    if (Math.exp(-0.5 * (dt / life) ** 2) * opacityOf(scene, k) <= FAINT) continue;
    const at = (d) => moved(motion, rows, row, d).map((by, i) => core[12 * k + i] + by);
    seen.push(() => [at(dt), at(dt + AHEAD)]);
  }
  return seen;
}

// Of those that bodies carry.
export function carriedRows(scene, t01) {
  const { motion, dynamic, hangs } = scene;
  if (!hangs) return [];
  const [now, then] = [0, AHEAD / motion.intervals].map((by) => posesAt(scene, t01 + by));
  const seen = [];
  for (let k = 0; k < dynamic; k++) {
    const body = hangs[5 * k];
    if (body > 0 && now[body - 1].there * opacityOf(scene, k) > FAINT) seen.push(() => [placeOf(scene, now, k), placeOf(scene, then, k)]);
  }
  return seen;
}
