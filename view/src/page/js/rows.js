// Gaussians that are free in time: a trajectory and a life of its own for each, by the trainer's kernel.

const THREADS = 64;

export class Rows {
  static async make(gpu, texts, scene) {
    const { gone, knots, spacing } = scene.motion;
    const constants = `const THREADS = ${THREADS}u;\nconst PER_THREAD = 1u;\nconst GONE = f32(${gone});\n`
      + `const VECTORS = ${scene.rowFloats / 4}u;\n`
      + (knots > 0 ? `const SIDE = ${knots}u;\nconst SPACING = f32(${spacing});` : '');
    const names = [knots > 0 ? 'knots' : 'parabola', 'row', 'forward'];
    const parts = await Promise.all(names.map((name) => texts.train(`motion/free_time/${name}.wgsl`)));
    const self = new Rows();
    self.kernel = await gpu.kernel('motion forward', [constants, ...parts]);
    Object.assign(self, { gpu, values: gpu.storageFrom(scene.rows), deltas: gpu.storage(48 * scene.dynamic), moment: gpu.uniform(32) });
    return self;
  }

  record(commands, scene, t01) {
    const { intervals, least_life } = scene.motion;
    const moment = new ArrayBuffer(32);
    new Uint32Array(moment)[0] = scene.dynamic;
    new Float32Array(moment).set([t01 * intervals, least_life], 1);
    this.gpu.upload(this.moment, new Uint8Array(moment));
    commands.dispatch(this.kernel, [this.moment, scene.core, this.values, this.deltas], Math.ceil(scene.dynamic / THREADS));
    return this.deltas;
  }
}
