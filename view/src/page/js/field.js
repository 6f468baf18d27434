// The deformation field of 4DGS: the trainer's kernels for its planes, and its network in one kernel of the page.

const ceil = (a, b) => Math.ceil(a / b);
const SPATIAL = ['xy', 'xz', 'yz'];
const TEMPORAL = ['xt', 'yt', 'zt'];
const HEADS = { position: [0, 3], scale: [3, 3], rotation: [6, 4], opacity: [10, 1] };

export class Field {
  // `field`: as the header of the scene has it, with the vectors of the file and `times`, the rows of the planes along time.
  static async make(gpu, texts, scene) {
    const { field } = scene;
    const self = new Field();
    const f4 = field.features / 4;
    const in4 = f4 * field.levels.length;
    const w4 = field.width / 4;
    // Planes one behind the other, lines beside them; places count groups of four.
    const planes = [];
    let place = 0;
    let lines = 0;
    const levels = new Uint32Array(24 * field.levels.length);
    field.levels.forEach((level, index) => {
      const cells = Array(3).fill(field.spatial_resolution * level);
      const put = (name) => {
        const values = field.vectors.get(`grid.level${index}.${name}`);
        planes.push([4 * place, values]);
        place += values.length / 4;
        return place - values.length / 4;
      };
      levels.set(cells, 24 * index);
      levels.set(SPATIAL.map(put), 24 * index + 4);
      levels.set(TEMPORAL.map(put), 24 * index + 8);
      levels.set(cells.map((n) => { lines += n * f4; return lines - n * f4; }), 24 * index + 12);
    });
    const all = new Float32Array(4 * place);
    for (const [at, values] of planes) all.set(values, at);
    const heads = Object.keys(HEADS).filter((name) => field.vectors.has(`head.${name}.0.weight`));
    const { blocks, biases } = pack(field, heads, in4, w4);
    const constants = `const LEVELS = ${field.levels.length}u;\nconst F4 = ${f4}u;`;
    const [shared, blend, gather, mlp] = await Promise.all(
      [texts.train('field/device/planes.wgsl'), texts.train('field/device/lines.wgsl'), texts.train('field/device/gather.wgsl'), texts.own('mlp.wgsl')]);
    [self.blend, self.gather, self.mlp] = await Promise.all([
      gpu.kernel('field lines', [constants, shared, blend]),
      gpu.kernel('field gather', [constants, shared, gather]),
      gpu.kernel('field MLP', [`const IN4 = ${in4}u;\nconst WIDTH4 = ${w4}u;\nconst HEADS = ${heads.length}u;`, mlp])]);
    Object.assign(self, { gpu, field, rows: scene.dynamic, lineGroups: lines, groups: scene.dynamic * in4 });
    self.levels = gpu.storageFrom(levels);
    self.parameters = gpu.storageFrom(all);
    self.lines = gpu.storage(16 * lines);
    self.blocks = gpu.storageFrom(blocks);
    self.biases = gpu.storageFrom(biases);
    self.heads = gpu.storageFrom(Uint32Array.from(heads.flatMap((name) => HEADS[name])));
    self.points = gpu.storage(16 * scene.dynamic);
    self.features = gpu.storage(16 * self.groups);
    self.deltas = gpu.storage(48 * scene.dynamic);
    self.count = gpu.uniformFrom(Uint32Array.of(scene.dynamic, 0, 0, 0));
    self.time = gpu.uniform(16);
    const [low, high] = field.aabb;
    const scale = low.map((l, i) => (high[i] > l ? 1 / (high[i] - l) : 0));
    const frame = new ArrayBuffer(48);
    new Float32Array(frame).set([...low, 0, ...scale, 0]);
    new Uint32Array(frame).set([scene.dynamic], 8);
    self.frame = gpu.uniformFrom(new Uint8Array(frame));
    return self;
  }

  record(commands, scene, t01) {
    const t = Math.min(Math.max(t01, 0), 1);
    const along = (this.field.upper_half ? 0.5 + 0.5 * t : t) * (this.field.times - 1);
    const row = Math.min(Math.floor(along), this.field.times - 2);
    const time = new ArrayBuffer(16);
    new Uint32Array(time).set([row, 0, this.lineGroups]);
    new Float32Array(time)[1] = along - row;
    this.gpu.upload(this.time, new Uint8Array(time));
    commands.dispatch(this.blend, [this.time, this.levels, this.parameters, this.lines], ceil(this.lineGroups, 256));
    commands.dispatch(this.gather, [this.frame, this.levels, this.parameters, this.lines, scene.core, this.points, this.features], ceil(this.groups, 256));
    commands.dispatch(this.mlp, [this.count, this.features, this.blocks, this.biases, this.heads, this.deltas], ceil(this.rows, 64));
    return this.deltas;
  }
}

// Weights as 4 x 4 blocks, column by column of inputs.
function pack(field, heads, in4, w4) {
  const blocks = new Float32Array(16 * (w4 * in4 + heads.length * (w4 * w4 + w4)));
  const biases = new Float32Array(4 * (w4 + heads.length * (w4 + 1)));
  let block = 0;
  let bias = 0;
  // `weight`: outputs x inputs; outputs are padded to a multiple of four.
  const layer = (name, out4, in4) => {
    const weight = field.vectors.get(`${name}.weight`);
    const from = field.vectors.get(`${name}.bias`);
    for (let j = 0; j < out4; j++) {
      for (let k = 0; k < in4; k++, block += 16) {
        for (let column = 0; column < 4; column++) {
          for (let row = 0; row < 4 && 4 * j + row < from.length; row++) {
            blocks[block + 4 * column + row] = weight[(4 * j + row) * 4 * in4 + 4 * k + column];
          }
        }
      }
    }
    biases.set(from, bias);
    bias += 4 * out4;
  };
  layer('trunk.0', w4, in4);
  for (const name of heads) {
    layer(`head.${name}.0`, w4, w4);
    layer(`head.${name}.1`, 1, w4);
  }
  return { blocks, biases };
}
