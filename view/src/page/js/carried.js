// Where bodies carry their Gaussians, for arrows; pictures are drawn by the trainer's kernels.

// How many bodies and nodes there are.
export const carriersOf = ({ names, nodes }) => ({ bodies: names.length, nodes });

const turned = ([w, x, y, z], [a, b, c]) => {
  const [u, v, s] = [y * c - z * b, z * a - x * c, x * b - y * a];
  return [a + 2 * (w * u + y * s - z * v), b + 2 * (w * v + z * u - x * s), c + 2 * (w * s + x * v - y * u)];
};

// Shift, turn and presence of all bodies, then of all nodes.
export function posesAt({ motion, control, other }, t01) {
  const { bodies, nodes } = carriersOf(motion);
  const count = bodies + nodes;
  const last = motion.control - 4;
  const s = Math.min(Math.max(t01, 0), 1) * (last + 1);
  const first = Math.min(Math.floor(s), last);
  const [u, v] = [s - first, 1 - (s - first)];
  const weights = [v ** 3, u * u * (3 * u - 6) + 4, u * (u * (3 - 3 * u) + 3) + 1, u ** 3].map((weight) => weight / 6);
  const open = (x) => 1 / (1 + Math.exp(-x));
  return Array.from({ length: count }, (_, entity) => {
    const sum = (from) => weights.reduce((total, weight, k) => total + weight * control[8 * ((first + k) * count + entity) + from], 0);
    const turn = [4, 5, 6, 7].map(sum);
    const length = Math.hypot(...turn) || 1;
    const [begin, end, gated] = other.subarray(4 * entity);
    const seconds = t01 * motion.seconds;
    const there = entity < bodies && gated > 0 ? open((seconds - begin) / motion.softness) * open((end - seconds) / motion.softness) : 1;
    return { shift: [0, 1, 2].map(sum), turn: turn.map((part) => part / length), there };
  });
}

// Where row `k` is that a body carries.
export function placeOf({ motion, core, other, hangs }, poses, k) {
  const { bodies } = carriersOf(motion);
  const x = [...core.subarray(12 * k, 12 * k + 3)];
  const body = poses[hangs[5 * k] - 1];
  const nodes = [...hangs.subarray(5 * k + 1, 5 * k + 5)].filter((id) => id > 0).map((id) => {
    const [a, b, c, reach] = other.subarray(4 * (bodies + id - 1));
    const off = [x[0] - a, x[1] - b, x[2] - c];
    const { shift, turn } = poses[bodies + id - 1];
    return { near: -0.5 * (off[0] ** 2 + off[1] ** 2 + off[2] ** 2) * Math.exp(-2 * reach), place: turned(turn, off).map((at, i) => at + [a, b, c][i] + shift[i]) };
  });
  const most = Math.max(...nodes.map(({ near }) => near));
  const shares = nodes.map(({ near }) => Math.exp(near - most));
  const all = shares.reduce((sum, share) => sum + share, 0);
  const inside = nodes.length ? [0, 1, 2].map((i) => nodes.reduce((sum, { place }, n) => sum + shares[n] / all * place[i], 0)) : x;
  return turned(body.turn, inside).map((at, i) => at + body.shift[i]);
}

// A colour for each body, 0 to 1: hues as far apart as can be, whatever their number.
export function colourOf(body) {
  const hue = (0.08 + 0.618034 * body) % 1;
  return [0, 1, 2].map((channel) => 0.3 + 0.7 * Math.min(1, Math.max(0, Math.abs((hue * 6 + [0, 4, 2][channel]) % 6 - 3) - 1)));
}
