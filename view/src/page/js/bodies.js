// Gaussians that bodies carry, by the trainer's kernels: the poses of bodies and nodes at an instant, then each Gaussian. Those of no body
// are free in time.

import { Rows } from './rows.js';
import { pathFloats } from './trajectory.js';
import { carriersOf } from './carried.js';

const THREADS = 64;

export class Bodies {
  static async make(gpu, texts, scene) {
    const { motion, control, other } = scene;
    // The same rows, of which this kernel looks at the path alone.
    const free = scene.hangs.some((id, k) => k % 5 === 0 && id === 0) ? await Rows.make(gpu, texts, scene) : null;
    const [shared, poses, row, carry] = await Promise.all(['shared', 'poses', 'row', 'carry'].map((name) => texts.train(`motion/bodies/${name}.wgsl`)));
    const constants = `const THREADS = ${THREADS}u;\nconst PER_THREAD = 1u;\nconst GONE = f32(${motion.gone});\n`
      + `const VECTORS = ${scene.rowFloats / 4}u;\nconst BODY = ${pathFloats(motion) / 4}u;\n`;
    const self = new Bodies();
    [self.place, self.carry] = await Promise.all([gpu.kernel('poses of bodies', [constants, shared, poses]), gpu.kernel('motion forward', [constants, shared, row, carry])]);
    const { bodies, nodes } = carriersOf(motion);
    Object.assign(self, {
      gpu, free, entities: bodies + nodes, counts: [scene.dynamic, bodies, nodes, motion.control],
      values: free?.values ?? gpu.storageFrom(scene.rows), deltas: free?.deltas ?? gpu.storage(48 * scene.dynamic),
      control: gpu.storageFrom(control), other: gpu.storageFrom(other), poses: gpu.storage(32 * (bodies + nodes)), moment: gpu.uniform(48),
    });
    return self;
  }

  record(commands, scene, t01) {
    const { gpu, moment, counts } = this;
    const { control, seconds, softness } = scene.motion;
    this.free?.record(commands, scene, t01);
    const at = new ArrayBuffer(48);
    new Uint32Array(at).set(counts);
    const t = Math.fround(t01);
    new Float32Array(at).set([t * (control - 3), t * seconds, softness], 4);
    gpu.upload(moment, new Uint8Array(at));
    commands.dispatch(this.place, [moment, this.control, this.other, this.poses], Math.ceil(this.entities / THREADS));
    commands.dispatch(this.carry, [moment, scene.core, this.values, this.poses, this.other, this.deltas], Math.ceil(counts[0] / THREADS));
    return this.deltas;
  }
}
