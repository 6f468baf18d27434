// The models of a page: what was learned, and who draws it.

import { NoGpu, open } from './gpu.js';
import { parse } from './scene.js';
import * as source from './source.js';
import { Drawn, Sent } from './pictures.js';

const TEXTS = { train: (name) => source.text(`train/${name}`), own: (name) => source.text(`wgsl/${name}`) };

// The device that draws, or why the server must.
async function device(abouts, wanted) {
  const beyond = abouts.find((about) => about.only_server);
  const alone = source.alone || abouts.some((about) => !about.from_run);
  if (beyond && alone) throw new Error(`A browser cannot draw ${beyond.name}: ${beyond.only_server}. Use erfgs view with its run.`);
  if (wanted === 'server' && !alone) return { why: 'as asked for in the address' };
  if (beyond) return { why: `the browser cannot draw ${beyond.name}: ${beyond.only_server}` };
  try {
    const gpu = await open(navigator.gpu);
    if (gpu.adapter.info?.isFallbackAdapter && wanted !== 'webgpu' && !alone) return { why: 'this browser has no graphics processor, only a slow stand-in' };
    return { gpu };
  } catch (error) {
    if (alone || !(error instanceof NoGpu)) throw error;
    return { why: error.message };
  }
}

export class Models {
  // `canvases`: one for each model; `told` hears what is being done; `wanted`: `webgpu`, `server` or nothing.
  static async load(abouts, canvases, wanted, told) {
    const self = new Models();
    Object.assign(self, { abouts, canvases, told, list: [] }, await device(abouts, wanted));
    for (const k of abouts.keys()) await self.renew(k);
    return self;
  }

  // Loads a model anew: it has learned more.
  async renew(k) {
    const { name, bytes } = this.abouts[k];
    const scene = parse(await source.scene(k, bytes, (share) => this.told(`loading ${name}: ${Math.round(100 * share)} %`)));
    const before = this.list[k];
    if (!before) this.told('preparing the kernels');
    if (this.gpu) {
      const painter = await Drawn.make(this.gpu, TEXTS, scene, this.canvases[k]);
      this.list[k] = { scene, painter };
      before?.painter.viewer.destroy();
    } else {
      this.list[k] = { scene, painter: before?.painter ?? new Sent(k, this.canvases[k]) };
    }
  }

  get scenes() { return this.list.map(({ scene }) => scene); }
  get painters() { return this.list.map(({ painter }) => painter); }
}
