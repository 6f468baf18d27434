// A scene file: the magic ERFGS4D1, the length of a JSON header (u32), the header, sections in the header's order.

const MAGIC = 'ERFGS4D1';
const FOREIGN = 'This is no scene of erfgs, or one of a later version.';

export function parse(buffer) {
  const bytes = new Uint8Array(buffer);
  if (bytes.length < 12 || new TextDecoder('latin1').decode(bytes.subarray(0, 8)) !== MAGIC) throw new Error(FOREIGN);
  const length = new DataView(buffer).getUint32(8, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(12, 12 + length)));
  const vectors = new Map();
  let at = 12 + length;
  for (const { name, floats, coding } of header.sections) {
    const size = sizeOf(coding, floats);
    if (at + size > bytes.length) throw new Error('The scene is cut off: load it again.');
    vectors.set(name, READERS[coding.kind](bytes.slice(at, at + size), floats, coding));
    at += size;
  }
  const { motion } = header;
  const field = motion.kind !== 'hexplane' ? null : {
    ...motion, vectors,
    times: vectors.get('grid.level0.xt').length / motion.features / (motion.spatial_resolution * motion.levels[0]),
  };
  return {
    header, motion, field,
    count: header.count, dynamic: header.dynamic, shDegree: header.sh_degree, activeShDegree: header.active_sh_degree,
    core: vectors.get('core'), sh: vectors.get('sh'), rows: vectors.get('motion'), points: vectors.get('points'),
  };
}

function sizeOf(coding, floats) {
  if (coding.kind === 'exact') return 4 * floats;
  if (coding.kind === 'half') return 2 * floats;
  if (coding.kind !== 'blocks') throw new Error(FOREIGN);
  const { rows, columns } = coding;
  const count = floats / columns.length;
  return Math.ceil(count / rows) * 8 * columns.length + count * columns.reduce((sum, size) => sum + size, 0);
}

const READERS = {
  exact: (bytes) => new Float32Array(bytes.buffer),

  half: (bytes, floats) => Float32Array.from(new Uint16Array(bytes.buffer, 0, floats), (code) => {
    const [exponent, fraction] = [code >> 10 & 31, code & 1023];
    const size = exponent === 0 ? fraction * 2 ** -24 : (1024 + fraction) * 2 ** (exponent - 25);
    return code >> 15 ? -size : size;
  }),

  // For each block of rows and column the least value and the step; then, by columns, the codes: upper bytes, lower bytes.
  blocks: (bytes, floats, { rows, columns }) => {
    const width = columns.length;
    const count = floats / width;
    const blocks = Math.ceil(count / rows);
    const ranges = new Float32Array(bytes.buffer, 0, 2 * blocks * width);
    const values = new Float32Array(floats);
    let at = ranges.byteLength;
    columns.forEach((size, column) => {
      for (let row = 0; row < count; row++) {
        const range = 2 * (Math.floor(row / rows) * width + column);
        const code = size === 2 ? bytes[at + row] << 8 | bytes[at + count + row] : size === 1 ? bytes[at + row] : 0;
        values[row * width + column] = ranges[range] + ranges[range + 1] * code;
      }
      at += size * count;
    });
    return values;
  },
};

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
