// What is drawn over the picture: the cameras of the rig, where what moves is going, events.

import { centreOf, distance } from './camera.js';
import { carriedRows, freeRows } from './arrows.js';

const COLOURS = { rgb: '#d9a441', event: '#6fa8ff', both: '#7fd18b', on: '#ff5a4f', off: '#4f8bff', velocity: '#7dffb0' };
// Arrows that are drawn at most.
const ARROWS = 1500;

// Pixel of a point, or nothing where it is behind the camera.
function project({ rotation: r, translation: t, fx, fy, cx, cy }, p) {
  const [x, y, z] = r.map((row, k) => row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + t[k]);
  return z > 1e-6 ? [fx * x / z + cx, fy * y / z + cy] : null;
}

export class Overlay {
  constructor(canvas) { Object.assign(this, { canvas, paint: canvas.getContext('2d') }); }

  begin(view) {
    const { canvas, paint } = this;
    if (canvas.width !== view.width || canvas.height !== view.height) Object.assign(canvas, { width: view.width, height: view.height });
    paint.clearRect(0, 0, view.width, view.height);
    this.view = view;
    this.unit = Math.max(1, view.height / 500);
  }

  #line(points, colour) {
    const pixels = points.map((p) => project(this.view, p));
    if (pixels.some((pixel) => !pixel)) return;
    const { paint } = this;
    paint.strokeStyle = colour;
    paint.lineWidth = 1.2 * this.unit;
    paint.beginPath();
    for (const pixel of pixels) paint.lineTo(...pixel);
    paint.stroke();
  }

  // Each camera as a pyramid with its name, coloured by what it records; held-out ones faintly.
  cameras(cameras, chosen) {
    const { paint } = this;
    const middle = [0, 1, 2].map((k) => cameras.reduce((sum, camera) => sum + centreOf(camera)[k], 0) / cameras.length);
    const spread = Math.max(...cameras.map((camera) => distance(centreOf(camera), middle)), 1e-6);
    for (const camera of cameras) {
      if (camera === chosen) continue;
      const { rotation: r, width, height, fx, fy, cx, cy } = camera;
      const eye = centreOf(camera);
      const depth = 0.07 * spread;
      const corner = (u, v) => {
        const ray = [(u - cx) / fx * depth, (v - cy) / fy * depth, depth];
        return [0, 1, 2].map((k) => eye[k] + r[0][k] * ray[0] + r[1][k] * ray[1] + r[2][k] * ray[2]);
      };
      const corners = [[0, 0], [width, 0], [width, height], [0, height]].map(([u, v]) => corner(u, v));
      paint.globalAlpha = camera.split === 'test' ? 0.45 : 1;
      const colour = COLOURS[camera.modality] ?? COLOURS.both;
      this.#line([...corners, corners[0]], colour);
      for (const point of corners) this.#line([eye, point], colour);
      const at = project(this.view, eye);
      if (at) {
        paint.fillStyle = colour;
        paint.font = `${11 * this.unit}px system-ui, sans-serif`;
        paint.fillText(camera.name, at[0] + 3 * this.unit, at[1]);
      }
    }
    paint.globalAlpha = 1;
  }

  // Where the Gaussians that are there at `t01` will be a quarter of an interval later.
  velocities(scene, t01) {
    const seen = [...freeRows(scene, t01), ...carriedRows(scene, t01)];
    const every = Math.ceil(seen.length / ARROWS);
    for (const way of seen.filter((_, k) => k % every === 0)) {
      const [from, to] = way().map((place) => project(this.view, place));
      if (!from || !to) continue;
      const { paint } = this;
      paint.strokeStyle = paint.fillStyle = COLOURS.velocity;
      paint.lineWidth = this.unit;
      paint.beginPath();
      paint.moveTo(...from);
      paint.lineTo(...to);
      paint.stroke();
      paint.fillRect(to[0] - this.unit, to[1] - this.unit, 2 * this.unit, 2 * this.unit);
    }
  }

  // Events of a camera that is looked through: columns, rows and polarities.
  events(packed, camera) {
    const { paint } = this;
    const scale = this.view.width / camera.width;
    for (const [polarity, colour] of [[0, COLOURS.off], [1, COLOURS.on]]) {
      paint.fillStyle = colour;
      for (let k = 0; k < packed.length; k += 3) {
        if (packed[k + 2] === polarity) paint.fillRect(packed[k] * scale, packed[k + 1] * scale, scale, scale);
      }
    }
  }
}
