// Cameras: those of the rig, and a free one that orbits and flies. OpenCV's axes: x right, y down, z forward.

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const dot = (a, b) => a.reduce((sum, v, i) => sum + v * b[i], 0);
export const scaled = (a, k) => a.map((v) => k * v);
const plus = (...all) => all[0].map((_, i) => all.reduce((sum, a) => sum + a[i], 0));
export const minus = (a, b) => a.map((v, i) => v - b[i]);
export const unit = (a) => scaled(a, 1 / (Math.hypot(...a) || 1));

export const lerp = (a, b, share) => a.map((v, i) => v + share * (b[i] - v));
export const distance = (a, b) => Math.hypot(...minus(a, b));

export const centreOf = ({ rotation: r, translation: t }) => [0, 1, 2].map((i) => -(r[0][i] * t[0] + r[1][i] * t[1] + r[2][i] * t[2]));

// The view of a camera of the rig in a picture that fits into `size`.
export function preset(camera, size) {
  const scale = Math.min(size[0] / camera.width, size[1] / camera.height);
  const [width, height] = [camera.width, camera.height].map((side) => Math.max(1, Math.round(side * scale)));
  const { rotation, translation, fx, fy, cx, cy } = camera;
  return { rotation, translation, width, height, fx: fx * scale, fy: fy * scale, cx: cx * scale, cy: cy * scale };
}

// Where the cameras look, and which way is up: the point nearest to all axes of view, and against the mean of the y axes.
export function overview(cameras) {
  const m = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  const v = [0, 0, 0];
  for (const camera of cameras) {
    const [axis, centre] = [camera.rotation[2], centreOf(camera)];
    for (let i = 0; i < 3; i++) {
      for (let j = 0; j < 3; j++) {
        const across = (i === j ? 1 : 0) - axis[i] * axis[j];
        m[i][j] += across;
        v[i] += across * centre[j];
      }
    }
  }
  // Cramer's rule; a single camera, or parallel ones, have no such point.
  const determinant = dot(m[0], cross(m[1], m[2]));
  const columns = [0, 1, 2].map((j) => m.map((row) => row[j]));
  const target = Math.abs(determinant) > 1e-6 * cameras.length ** 3
    ? [0, 1, 2].map((k) => { const c = columns.map((column, j) => (j === k ? v : column)); return dot(c[0], cross(c[1], c[2])) / determinant; })
    : plus(centreOf(cameras[0]), scaled(cameras[0].rotation[2], 2));
  const up = unit(cameras.map((camera) => camera.rotation[1]).reduce((a, b) => minus(a, b), [0, 0, 0]));
  const distances = cameras.map((camera) => Math.hypot(...minus(centreOf(camera), target))).sort((a, b) => a - b);
  const slopes = cameras.map((camera) => camera.height / 2 / camera.fy).sort((a, b) => a - b);
  return { target, up, distance: distances[distances.length >> 1] || 1, slope: slopes[slopes.length >> 1] };
}

// A camera that looks at a target from a distance, in angles about the axis that points up.
export class FreeCamera {
  constructor({ target, up, distance, slope }) {
    const side = unit(cross(up, Math.abs(up[2]) > 0.9 ? [1, 0, 0] : [0, 0, 1]));
    Object.assign(this, { target, up, distance, slope, side, ahead: cross(side, up), yaw: 0, pitch: 0.2, far: distance });
  }

  // Away from what is looked at.
  back() {
    const [c, s] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    return plus(scaled(this.side, c * Math.sin(this.yaw)), scaled(this.ahead, -c * Math.cos(this.yaw)), scaled(this.up, s));
  }

  // Takes the place of a camera of the rig.
  from(camera) {
    const [eye, forward] = [centreOf(camera), camera.rotation[2]];
    const depth = dot(minus(this.target, eye), forward);
    this.distance = depth > 0.05 * this.far ? depth : this.far;
    this.target = plus(eye, scaled(forward, this.distance));
    this.pitch = Math.asin(Math.min(1, Math.max(-1, -dot(forward, this.up))));
    this.yaw = Math.atan2(-dot(forward, this.side), dot(forward, this.ahead));
    this.slope = camera.height / 2 / camera.fy;
  }

  turn(dx, dy) {
    this.yaw += dx;
    this.pitch = Math.min(1.55, Math.max(-1.55, this.pitch + dy));
  }

  // Looks around from where it stands.
  look(dx, dy) {
    const eye = plus(this.target, scaled(this.back(), this.distance));
    this.turn(dx, dy);
    this.target = minus(eye, scaled(this.back(), this.distance));
  }

  // Moves by shares of the distance: right, down, forward.
  move(right, down, forward) {
    const { rotation } = this.view([1, 1]);
    const ways = [right, down, forward].map((share, k) => scaled(rotation[k], share * this.distance));
    this.target = plus(this.target, ...ways);
  }

  zoom(factor) { this.distance = Math.min(100 * this.far, Math.max(1e-3 * this.far, this.distance * factor)); }

  view([width, height]) {
    const forward = scaled(this.back(), -1);
    const right = unit(cross(forward, this.up));
    const rotation = [right, cross(forward, right), forward];
    const eye = minus(this.target, scaled(forward, this.distance));
    const f = height / 2 / this.slope;
    return { rotation, translation: rotation.map((row) => -dot(row, eye)), width, height, fx: f, fy: f, cx: width / 2, cy: height / 2 };
  }

  // A place on a path, in a picture of this size.
  along({ rotation, translation, slope }, [width, height]) {
    const f = height / 2 / slope;
    return { rotation, translation, width, height, fx: f, fy: f, cx: width / 2, cy: height / 2 };
  }

  // For links.
  text() { return [...this.target, this.distance, this.yaw, this.pitch].map((v) => Number(v.toFixed(4))).join(','); }

  read(text) {
    const numbers = text.split(',').map(Number);
    if (numbers.length !== 6 || !numbers.every(Number.isFinite)) return false;
    [this.target, this.distance, this.yaw, this.pitch] = [numbers.slice(0, 3), numbers[3], numbers[4], numbers[5]];
    return true;
  }
}
