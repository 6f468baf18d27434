// A path of the camera: key frames of place and time, as `erfgs render --path` takes them.

import { centreOf, dot, lerp, minus, scaled, unit } from './camera.js';

// Seconds from one key frame to the next.
export const LEG_SECONDS = 2;

// Unit quaternion (w x y z) of a rotation by its rows.
function quaternion([[a, b, c], [d, e, f], [g, h, i]]) {
  const trace = a + e + i;
  if (trace > 0) {
    const s = 2 * Math.sqrt(1 + trace);
    return [s / 4, (h - f) / s, (c - g) / s, (d - b) / s];
  }
  if (a > e && a > i) {
    const s = 2 * Math.sqrt(1 + a - e - i);
    return [(h - f) / s, s / 4, (b + d) / s, (c + g) / s];
  }
  if (e > i) {
    const s = 2 * Math.sqrt(1 + e - a - i);
    return [(c - g) / s, (b + d) / s, s / 4, (f + h) / s];
  }
  const s = 2 * Math.sqrt(1 + i - a - e);
  return [(d - b) / s, (c + g) / s, (f + h) / s, s / 4];
}

const rows = ([w, x, y, z]) => [
  [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
  [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
  [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
];

// Along the shortest arc.
function slerp(a, b, share) {
  const cosine = dot(a, b);
  const to = cosine < 0 ? scaled(b, -1) : b;
  const angle = Math.acos(Math.min(1, Math.abs(cosine)));
  if (angle < 1e-6) return unit(lerp(a, to, share));
  return unit(a.map((v, k) => (Math.sin((1 - share) * angle) * v + Math.sin(share * angle) * to[k]) / Math.sin(angle)));
}

export class CameraPath {
  keys = [];

  // `view`: rotation and translation; `slope`: half the height of the picture at distance 1.
  add({ rotation, translation, height, fy }, t01) {
    this.keys.push({ q: unit(quaternion(rotation)), centre: centreOf({ rotation, translation }), t01, slope: height / 2 / fy });
  }

  clear() { this.keys = []; }
  get seconds() { return Math.max(0, this.keys.length - 1) * LEG_SECONDS; }

  // Place and time so many seconds from the first key frame: centres and times on lines, rotations on arcs.
  at(seconds) {
    const along = Math.min(seconds / LEG_SECONDS, this.keys.length - 1);
    const from = Math.max(0, Math.min(Math.floor(along), this.keys.length - 2));
    const [a, b] = [this.keys[from], this.keys[Math.min(from + 1, this.keys.length - 1)]];
    const share = along - from;
    const rotation = rows(slerp(a.q, b.q, share));
    const centre = lerp(a.centre, b.centre, share);
    const [t01, slope] = lerp([a.t01, a.slope], [b.t01, b.slope], share);
    return { rotation, translation: rotation.map((row) => -dot(row, centre)), t01, slope };
  }

  // The file for `erfgs render --path`; `seconds`: the length of the recording.
  file(seconds) {
    const [width, height] = [1280, 720];
    const f = height / 2 / this.keys[0].slope;
    return JSON.stringify({
      intrinsics: { width, height, fx: f, fy: f, cx: width / 2, cy: height / 2, distortion: 'none' },
      world_to_camera: this.keys.map(({ q, centre }) => ({ rotation_wxyz: q, translation_m: rows(q).map((row) => -dot(row, centre)) })),
      times_s: this.keys.map(({ t01 }) => t01 * seconds),
    }, null, 1);
  }
}
