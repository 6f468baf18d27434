// A scene file: the magic ERFGS4D1, the length of a JSON header (u32), the header, sections of f32 in the header's order.

const MAGIC = 'ERFGS4D1';

export function parse(buffer) {
  const bytes = new Uint8Array(buffer);
  if (new TextDecoder('latin1').decode(bytes.subarray(0, 8)) !== MAGIC) throw new Error('This is no scene of erfgs.');
  const length = new DataView(buffer).getUint32(8, true);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(12, 12 + length)));
  const vectors = new Map();
  let at = 12 + length;
  for (const [name, count] of header.sections) {
    if (at + 4 * count > buffer.byteLength) throw new Error('The scene is cut off: load it again.');
    vectors.set(name, new Float32Array(buffer, at, count));
    at += 4 * count;
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

// The near plane of a view, metres: a share of the depth before which lies a hundredth of the initial points in view.
export function nearOf(scene, view) {
  const [least, share] = scene.header.near;
  const depths = [];
  const { rotation: r, translation: t, width, height, fx, fy, cx, cy } = view;
  const p = scene.points;
  for (let i = 0; share > 0 && i < p.length; i += 3) {
    const [x, y, z] = r.map((row, k) => row[0] * p[i] + row[1] * p[i + 1] + row[2] * p[i + 2] + t[k]);
    const [u, v] = [fx * x / z + cx, fy * y / z + cy];
    if (z > 0 && u >= 0 && u < width && v >= 0 && v < height) depths.push(z);
  }
  if (depths.length < 100) return least;
  depths.sort((a, b) => a - b);
  return Math.max(least, share * depths[Math.floor(depths.length / 100)]);
}
