// A scene file: a magic, the length of a JSON header (u32), the header, sections in the header's order. The most important Gaussians
// come first, so that a picture of them is there before the rest is.

import { SH_STRIDE, checked } from './header.js';
import { CUT_OFF, DAMAGED, FOREIGN, READERS, isCount, need, sizeOf } from './codings.js';
import { NEVER, pathFloats, rowFloats } from './trajectory.js';

// The first version had each section whole.
const MAGICS = ['ERFGS4D1', 'ERFGS4D2'];

// Takes the bytes of a scene as they come, of which there are `total`.
export class SceneReader {
  constructor(total) {
    need(isCount(total));
    // How much can be shown: nothing, 1 for the header alone, one more for each coarse part, Infinity for all; and how much of that
    // was given away.
    Object.assign(this, { bytes: new Uint8Array(total), at: 0, read: 0, sections: 0, best: 0, given: 0, vectors: new Map() });
  }

  get share() { return this.bytes.length ? this.at / this.bytes.length : 1; }

  push(bytes) {
    need(this.at + bytes.length <= this.bytes.length, 'The scene is longer than its header states: reload the page.');
    this.bytes.set(bytes, this.at);
    this.at += bytes.length;
    try {
      this.#parse();
    } catch (error) {
      // What the header lacks shows where it is used.
      throw error instanceof TypeError || error instanceof RangeError || error instanceof SyntaxError ? new Error(DAMAGED) : error;
    }
    this.#wake();
  }

  // No more bytes come: all is there, or `error` says why not.
  end(error) {
    this.failed = error ?? (this.best === Infinity ? null : new Error(CUT_OFF));
    this.#wake();
  }

  // Waits for more than what was given last, and for `least` of it; gives the scene as far as it is there.
  async better(least = 1) {
    while (this.best <= this.given || this.best < least) {
      if (this.failed) throw this.failed;
      await new Promise((wake) => { this.wake = wake; });
    }
    this.given = this.best;
    return this.#scene();
  }

  #wake() {
    if (this.best > this.given || this.failed) this.wake?.();
  }

  #parse() {
    const { bytes } = this;
    if (!this.header) {
      if (this.at < 12) return need(bytes.length >= 12, FOREIGN);
      need(MAGICS.includes(new TextDecoder('latin1').decode(bytes.subarray(0, 8))), FOREIGN);
      const end = 12 + new DataView(bytes.buffer).getUint32(8, true);
      need(end <= bytes.length);
      if (this.at < end) return undefined;
      this.header = checked(JSON.parse(new TextDecoder().decode(bytes.subarray(12, end))), bytes.length - end);
      // Looked up for each section, of which there may be any number.
      this.lengths = new Map();
      for (const { name, floats, at = 0 } of this.header.sections) this.lengths.set(name, Math.max(this.lengths.get(name) ?? 0, at + floats));
      this.levels = new Map((this.header.coarse ?? []).map((part, level) => [part.sections, level]).reverse());
      this.read = end;
      this.best = 1;
    }
    const { sections } = this.header;
    while (this.sections < sections.length) {
      const { name, floats, coding, at = 0 } = sections[this.sections];
      const end = this.read + sizeOf(coding, floats);
      if (this.at < end) return undefined;
      const values = READERS[coding.kind](bytes.slice(this.read, end), floats, coding);
      if (!this.vectors.has(name)) {
        const length = this.lengths.get(name);
        this.vectors.set(name, floats === length ? values : new Float32Array(length));
      }
      if (floats !== this.vectors.get(name).length) this.vectors.get(name).set(values, at);
      this.read = end;
      this.sections += 1;
      const level = this.levels.get(this.sections);
      if (level !== undefined) this.best = 2 + level;
    }
    this.best = Infinity;
    return undefined;
  }

  #scene() {
    const { header, vectors, best } = this;
    const whole = best === Infinity;
    const count = { moving: header.dynamic, standing: header.count - header.dynamic };
    const there = whole ? count : best === 1 ? { moving: 0, standing: 0 } : { moving: header.coarse[best - 2].dynamic, standing: header.coarse[best - 2].still };
    // Of rows of so many numbers, those that are there: the first that move and the first that stand still.
    const rows = (name, floats, standing = there.standing) => {
      const all = vectors.get(name);
      if (whole || !all) return all;
      const some = new Float32Array(floats * (there.moving + standing));
      some.set(all.subarray(0, floats * there.moving));
      some.set(all.subarray(floats * count.moving, floats * (count.moving + standing)), floats * there.moving);
      return some;
    };
    // What a field moves stands still until the field is there.
    const planes = header.sections.slice(this.sections).every(({ name }) => ROWS.includes(name));
    const motion = header.motion.kind === 'hexplane' && !planes ? { kind: 'still' } : header.motion;
    const field = motion.kind !== 'hexplane' ? null : {
      ...motion, vectors,
      times: vectors.get('grid.level0.xt').length / motion.features / (motion.spatial_resolution * motion.levels[0]),
    };
    const paths = rows('motion', pathFloats(header.motion), 0);
    const hangs = rows('hangs', 5, 0);
    return {
      header, motion, field, whole,
      count: there.moving + there.standing, dynamic: motion.kind === 'still' ? 0 : there.moving,
      shDegree: header.sh_degree, activeShDegree: header.active_sh_degree,
      core: rows('core', 12), sh: rows('sh', SH_STRIDE[header.sh_degree]), rows: hangs ? joined(motion, paths, hangs) : paths, points: vectors.get('points'),
      hangs, control: vectors.get('bodies.control'), other: vectors.get('bodies.other'), rowFloats: rowFloats(motion),
    };
  }
}

// Rows as the trainer has them, where bodies carry some: the path, then what the row hangs on. What a body carries is at no instant of its own.
function joined(motion, paths, hangs) {
  const [path, whole] = [pathFloats(motion), rowFloats(motion)];
  const { names, nodes } = motion;
  const count = hangs.length / 5;
  const rows = new Float32Array(whole * count);
  for (let k = 0; k < count; k++) {
    const on = hangs.subarray(5 * k, 5 * k + 5);
    need(on[0] <= names.length && on.every((id, n) => Number.isInteger(id) && id >= 0 && (n === 0 || id <= nodes)));
    rows.set(paths.subarray(path * k, path * (k + 1)), whole * k);
    rows.set(on, whole * k + path);
    if (on[0] > 0) rows[whole * k + 3] = NEVER;
  }
  return rows;
}

// Sections of rows of Gaussians.
const ROWS = ['core', 'sh', 'motion', 'hangs'];

// Depths (metres, ascending) of the initial points that a view sees.
export function depthsOf(scene, { rotation: r, translation: t, width, height, fx, fy, cx, cy }) {
  const depths = [];
  const p = scene.points;
  for (let i = 0; i < p.length; i += 3) {
    const [x, y, z] = r.map((row, k) => row[0] * p[i] + row[1] * p[i + 1] + row[2] * p[i + 2] + t[k]);
    const [u, v] = [fx * x / z + cx, fy * y / z + cy];
    if (z > 0 && u >= 0 && u < width && v >= 0 && v < height) depths.push(z);
  }
  return depths.sort((a, b) => a - b);
}

// The near plane of a view, metres: a share of the depth before which lies a hundredth of the initial points in view.
export function nearOf(scene, view) {
  const [least, share] = scene.header.near;
  const depths = share > 0 ? depthsOf(scene, view) : [];
  return depths.length < 100 ? least : Math.max(least, share * depths[Math.floor(depths.length / 100)]);
}
