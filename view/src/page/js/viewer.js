// Scene, motion and rasteriser together: pictures of a scene on a device of the browser.

import { Sorter } from './sort.js';
import { Projector, Tiles, Quads, Blit, viewUniform } from './raster.js';
import { Field } from './field.js';
import { Rows } from './rows.js';
import { Bodies } from './bodies.js';
import { colourOf } from './carried.js';
import { centreOf, distance } from './camera.js';
import { depthsOf } from './scene.js';

// Back to front, eight bits lose 3 dB and more: quads are summed in half precision.
const ACCUMULATE = 'rgba16float';
// Square pixels of the images that were trained on.
const LOW_PASS = 0.3;
// The zeroth harmonic.
const SH_C0 = 0.28209479;
// Looks that show colours, which both modes draw.
const PLAIN = ['colours', 'bodies'];
// An opacity of nothing, as a logit.
const GONE = -100;

// What blend_gpu.wgsl takes.
const TILES_WORKGROUP_BYTES = 16416;

// Bytes of the largest buffer that a scene takes on the device, all of which is bound at once.
export function largest({ count, dynamic, sh, rows, field }) {
  const moving = Math.max(48, 4 * (rows?.length ?? 0) / Math.max(1, dynamic), field ? 4 * field.features * field.levels.length : 0);
  return Math.max(64 * count, sh.byteLength, moving * dynamic);
}

// Destroys the buffers that an object of the page owns, and those of the objects that it holds only for that.
function release(part) {
  for (const value of Object.values(part ?? {})) {
    if (value instanceof GPUBuffer) value.destroy();
    else if (value && Object.getPrototypeOf(value) === Object.prototype) release(value);
  }
}

export class Viewer {
  static async make(gpu, texts, scene, format) {
    const self = new Viewer();
    const uploaded = { ...scene, core: gpu.storageFrom(scene.core), sh: gpu.storageFrom(scene.sh) };
    Object.assign(self, { gpu, texts, format, scene: uploaded, host: scene });
    self.sorter = new Sorter(gpu, texts);
    [self.projector, self.quads, self.motion, self.blitTexture] = await Promise.all([
      Projector.make(gpu, texts, uploaded),
      Quads.make(gpu, texts, self.sorter, uploaded, ACCUMULATE),
      scene.dynamic === 0 ? null : (scene.field ? Field : scene.motion.kind === 'bodies' ? Bodies : Rows).make(gpu, texts, uploaded),
      Blit.make(gpu, texts, format, 'blit_texture.wgsl'),
      gpu.onProcessor ? null : self.sorter.prepare()]);
    // Seen k times as large as in training, a splat needs k^2 times the low pass, or thin ones shrink to needles.
    self.trainedFocal = Math.max(1e-3, ...scene.header.cameras.map((camera) => camera.fx));
    return self;
  }

  // Makes what a mode or a look needs: kernels and memory that most pages never use.
  async prepare({ mode, look = 'colours' }) {
    if (!PLAIN.includes(look) || mode !== 'tiles') {
      await this.quads.prepare(PLAIN.includes(look) ? 'colours' : look);
      return;
    }
    if (this.tiles) return;
    const { gpu, texts, format } = this;
    const most = gpu.device.limits.maxComputeWorkgroupStorageSize;
    if (most < TILES_WORKGROUP_BYTES) throw new Error(`This graphics device cannot draw exactly: its workgroups have ${most} bytes of memory, not ${TILES_WORKGROUP_BYTES}.`);
    this.blit = await Blit.make(gpu, texts, format, 'blit.wgsl');
    this.tiles = await Tiles.make(gpu, texts, this.sorter, this.scene);
  }

  // The parameters of those that are shown: `all`, those that `move` or `stand` alone, or those of a body (`body:` and its name).
  core(layer) {
    this.cores ??= { all: this.scene.core };
    const { core: all, count, dynamic, hangs, motion } = this.host;
    const body = layer.startsWith('body:') ? 1 + (motion.names?.indexOf(layer.slice(5)) ?? -1) : null;
    // A scene beside it, which has no such body, is shown whole.
    if (body === 0) return this.cores.all;
    if (!this.cores[layer]) {
      const core = all.slice();
      const shown = body ? (k) => k < dynamic && hangs[5 * k] === body : (k) => k < dynamic === (layer === 'move');
      for (let k = 0; k < count; k++) if (!shown(k)) core[12 * k + 10] = GONE;
      this.cores[layer] = this.gpu.storageFrom(core);
    }
    return this.cores[layer];
  }

  // The colours of a look: with `bodies` each body has one, as bright as its Gaussians are, and what none carries is grey.
  harmonics(look) {
    this.colours ??= { own: this.scene.sh };
    if (look !== 'bodies' || !this.host.hangs) return this.colours.own;
    if (!this.colours.bodies) {
      const { sh, count, dynamic, hangs } = this.host;
      const stride = sh.length / Math.max(1, count);
      const tinted = new Float32Array(sh.length);
      for (let k = 0; k < count; k++) {
        const [r, g, b] = [0, 1, 2].map((channel) => 0.5 + SH_C0 * sh[stride * k + channel]);
        const bright = Math.min(1, Math.max(0, 0.3 * r + 0.6 * g + 0.1 * b));
        const body = k < dynamic ? hangs[5 * k] : 0;
        const colour = body > 0 ? colourOf(body - 1).map((c) => c * (0.4 + 0.6 * bright)) : Array(3).fill(0.5 * bright);
        colour.forEach((c, channel) => { tinted[stride * k + channel] = (c - 0.5) / SH_C0; });
      }
      this.colours.bodies = this.gpu.storageFrom(tinted);
    }
    return this.colours.bodies;
  }

  // Depths of the initial points in view between which colours are spread.
  depths(view) {
    const all = depthsOf(this.host, view);
    const share = (at) => all[Math.floor(at * (all.length - 1))];
    return all.length > 10 ? [share(0.02), Math.max(1.01 * share(0.02), share(0.98))] : [0.1, 10];
  }

  // The nearest depth that there can be, and one that is further than all: what moves leaves the box of the places by less than its size.
  range(view, near) {
    const { core, count } = this.host;
    if (!this.box) {
      const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
      for (let k = 0; k < 12 * count; k += 12) {
        for (let i = 0; i < 3; i++) {
          low[i] = Math.min(low[i], core[k + i]);
          high[i] = Math.max(high[i], core[k + i]);
        }
      }
      this.box = { middle: low.map((v, i) => (v + high[i]) / 2), size: Math.hypot(...low.map((v, i) => high[i] - v)) };
    }
    const nearest = Math.max(near, 1e-6);
    return [nearest, Math.max(2 * nearest, distance(centreOf(view), this.box.middle) + 1.5 * this.box.size || 0)];
  }

  // Draws into the view of a texture that `target` gives, at `t01`, with the near plane `near`, metres; `mode`: `quads` or `tiles`;
  // `look` and `layer`: what of the scene is seen (quads alone have looks). One picture after the other, for they share buffers.
  frame(...picture) {
    this.last = (this.last ?? Promise.resolve()).catch(() => {}).then(() => this.#frame(...picture));
    return this.last;
  }

  async #frame(view, t01, target, { mode: wanted = 'quads', near, look = 'colours', layer = 'all' }) {
    if (this.gone) return;
    const mode = PLAIN.includes(look) ? wanted : 'quads';
    Object.assign(this.scene, { core: this.core(layer), sh: this.harmonics(look) });
    const { gpu, scene, quads } = this;
    const { background, near_sigmas: nearSigmas } = scene.header;
    const room = mode === 'tiles' ? this.tiles.fit(view.width, view.height, this.room) : 0;
    const lowPass = LOW_PASS * Math.max(1, view.fx / this.trainedFocal) ** 2;
    const deltaRows = this.motion ? scene.dynamic : 0;
    gpu.upload(this.projector.view, viewUniform(view, scene, { near, nearSigmas, background, deltaRows, room, lowPass }));
    let commands = gpu.commands();
    const deltas = this.motion?.record(commands, scene, t01);
    this.projector.record(commands, scene, deltas);
    if (mode === 'tiles') {
      this.tiles.record(commands, this.projector);
      const size = () => gpu.uniformFrom(Uint32Array.of(view.width, view.height, 0, 0));
      this.blit.record(commands, this.tiles.image, () => [{ buffer: size() }, { buffer: this.tiles.image }], target());
      commands.submit();
      return;
    }
    quads.recordKeys(commands, this.projector, this.range(view, near));
    if (gpu.onProcessor) {
      commands.submit();
      const order = await quads.order();
      if (this.gone) return;
      gpu.upload(quads.byDepth.values, order);
      commands = gpu.commands();
    } else quads.recordOrder(commands);
    if (this.sums?.width !== view.width || this.sums?.height !== view.height) {
      this.sums?.destroy();
      const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.TEXTURE_BINDING;
      this.sums = gpu.device.createTexture({ size: [view.width, view.height], format: ACCUMULATE, usage });
    }
    const sums = this.sums.createView();
    const depths = look === 'depth' ? this.depths(view) : [1, 2];
    const shown = PLAIN.includes(look) ? 'colours' : look;
    quads.record(commands, this.projector, sums, look === 'depth' ? [0, 0, 0] : background, { look: shown, depths });
    this.blitTexture.record(commands, this.sums, () => [sums], target());
    commands.submit();
  }

  // Frees the device's memory.
  destroy() {
    for (const part of [this.scene, this.cores, this.colours, this.motion?.free, this.projector, this.tiles, this.quads, this.motion]) release(part);
    this.sums?.destroy();
    this.gone = true;
  }

  // After a frame of tiles: whether intersections were left out for want of room, which there is the next time.
  async lacked() {
    if (this.gone || !this.tiles?.image) return false;
    const wanted = await this.tiles.wanted();
    if (wanted <= this.tiles.room) return false;
    // A list of numbers must fit one binding.
    const most = Math.floor(Math.min(this.gpu.device.limits.maxStorageBufferBindingSize, this.gpu.device.limits.maxBufferSize) / 4);
    if (wanted > most) throw new Error(`From here ${wanted.toLocaleString('en')} tiles are covered, and the graphics device has room for ${most.toLocaleString('en')}: draw fast.`);
    this.room = Math.min(most, Math.ceil(1.25 * wanted));
    return true;
  }

  // RGBA bytes of a picture.
  async pixels(view, t01, options) {
    const { device } = this.gpu;
    const usage = GPUTextureUsage.RENDER_ATTACHMENT | GPUTextureUsage.COPY_SRC;
    const texture = device.createTexture({ size: [view.width, view.height], format: this.format, usage });
    do await this.frame(view, t01, () => texture.createView(), options);
    while (options.mode === 'tiles' && await this.lacked());
    const stride = Math.ceil(4 * view.width / 256) * 256;
    const copy = device.createBuffer({ size: stride * view.height, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    const encoder = device.createCommandEncoder();
    encoder.copyTextureToBuffer({ texture }, { buffer: copy, bytesPerRow: stride }, [view.width, view.height]);
    device.queue.submit([encoder.finish()]);
    await copy.mapAsync(GPUMapMode.READ);
    const padded = new Uint8Array(copy.getMappedRange());
    const pixels = new Uint8Array(4 * view.width * view.height);
    for (let y = 0; y < view.height; y++) pixels.set(padded.subarray(y * stride, y * stride + 4 * view.width), 4 * view.width * y);
    copy.destroy();
    texture.destroy();
    if (this.format === 'bgra8unorm') for (let i = 0; i < pixels.length; i += 4) [pixels[i], pixels[i + 2]] = [pixels[i + 2], pixels[i]];
    return pixels;
  }
}
