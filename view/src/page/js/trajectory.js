// Where a row of a Gaussian that is free in time takes it, for arrows; pictures are drawn by the trainer's kernel.

// Numbers of the path of a row, in the file; on the device bodies keep eight more behind them.
export const pathFloats = ({ knots }) => 8 * Math.max(1, knots ?? 0);
export const rowFloats = (motion) => pathFloats(motion) + (motion.kind === 'bodies' ? 8 : 0);

// The instant of what a body carries.
export const NEVER = 1e9;

// How far the row at `row` is from its place `dt` intervals after its instant, metres: along a parabola, or, for arrows well enough,
// straight from knot to knot.
export function moved({ knots, spacing }, rows, row, dt) {
  if (!knots) return [0, 1, 2].map((i) => dt * (rows[row + i] + 0.5 * dt * rows[row + 4 + i]));
  const u = dt / spacing;
  const from = Math.max(-knots, Math.min(knots - 1, Math.floor(u)));
  const knot = (k, i) => (k === 0 ? 0 : rows[row + 4 * (k > 0 ? k + knots - 1 : k + knots) + i]);
  return [0, 1, 2].map((i) => knot(from, i) + (u - from) * (knot(from + 1, i) - knot(from, i)));
}
