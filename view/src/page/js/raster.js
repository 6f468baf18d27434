// Two ways from Gaussians to pixels. `Projector` runs the trainer's project.wgsl, `Tiles` the trainer's tile lists and
// blending (its shape for GPUs), `Quads` instanced quads with alpha blending.

import { SH_STRIDE } from './header.js';
import { Plan, PLAN_BYTES, BLOCK_GROUPS, sorted } from './sort.js';

const THREADS = 64;
const TILE = 16;
const ceil = (a, b) => Math.ceil(a / b);

// Of the uniform below.
const VIEW_BYTES = 192;
// The trainer's `Thresholds`, as they are by default.
const NEGLIGIBLE_ALPHA = 1 / 255;
const LEAST_TRANSMITTANCE = 1e-4;

// The uniform of raster/shared/view.wgsl; the twin of `ViewUniform` in the trainer.
export function viewUniform(view, scene, { near = 0.2, nearSigmas = 3, background = [0, 0, 0], deltaRows = 0, room = 0, lowPass = 0.3 } = {}) {
  const bytes = new ArrayBuffer(VIEW_BYTES);
  const f = new Float32Array(bytes);
  const u = new Uint32Array(bytes);
  const { rotation: r, translation: t, width: w, height: h, fx, fy, cx, cy } = view;
  for (let row = 0; row < 3; row++) f.set([...r[row], t[row]], 4 * row);
  const centre = [0, 1, 2].map((i) => -(r[0][i] * t[0] + r[1][i] * t[1] + r[2][i] * t[2]));
  f.set([...centre, Math.max(near, 1e-6)], 12);
  f.set([fx, fy, cx, cy], 16);
  f.set([(-0.15 * w - cx) / fx, (1.15 * w - cx) / fx, (-0.15 * h - cy) / fy, (1.15 * h - cy) / fy], 20);
  f.set([...background, nearSigmas], 24);
  u.set([w, h, ceil(w, TILE), ceil(h, TILE)], 28);
  u.set([scene.count, deltaRows, scene.activeShDegree, SH_STRIDE[scene.shDegree]], 32);
  u.set([0, 0, 0, room], 36);
  f[43] = lowPass;
  f.set([NEGLIGIBLE_ALPHA, Math.log2(NEGLIGIBLE_ALPHA), LEAST_TRANSMITTANCE], 44);
  return new Uint8Array(bytes);
}

const part = (name) => `raster/${name}.wgsl`;

export class Projector {
  static async make(gpu, texts, scene) {
    const self = new Projector();
    const parts = await Promise.all(['shared/view', 'shared/splat', 'shared/gaussian', 'shared/harmonics', 'shared/colour', 'project'].map((n) => texts.train(part(n))));
    self.kernel = await gpu.kernel('project', [`const THREADS = ${THREADS}u;`, ...parts]);
    self.view = gpu.uniform(VIEW_BYTES);
    self.splats = gpu.storage(64 * Math.max(1, scene.count));
    self.none = gpu.storage(16);
    return self;
  }

  record(commands, scene, deltas) {
    const bindings = [this.view, scene.core, scene.sh, deltas ?? this.none, this.none, this.splats];
    commands.dispatch(this.kernel, bindings, ceil(scene.count, THREADS));
  }
}

export class Tiles {
  static async make(gpu, texts, sorter, scene) {
    const self = new Tiles();
    const [sort, view, splat, tiles, ...stages] = await Promise.all(['sort/shared.wgsl', ...['shared/view', 'shared/splat', 'shared/tiles',
      'intersect', 'order', 'emit', 'plan_tiles', 'tile_ranges', 'blend_gpu'].map(part)].map((name) => texts.train(name)));
    const [intersect, order, emit, plan, ranges, blend] = stages;
    const threads = `const THREADS = ${THREADS}u;`;
    [self.intersect, self.order, self.emit, self.planTiles, self.ranges, self.blend] = await Promise.all([
      gpu.kernel('intersect', [threads, view, splat, tiles, intersect]),
      gpu.kernel('order', [threads, view, splat, tiles, order]),
      gpu.kernel('emit', [threads, view, splat, tiles, emit]),
      gpu.kernel('plan tiles', [sort, view, splat, plan]),
      gpu.kernel('tile ranges', [sort, view, splat, ranges]),
      gpu.kernel('blend', ['const WITH_DEPTH = false;', view, splat, tiles, blend]),
      sorter.prepare(),
    ]);
    Object.assign(self, { gpu, sorter, count: scene.count, room: 0 });
    const n = scene.count;
    self.counts = gpu.storage(4 * n);
    self.offsets = gpu.storage(4 * n);
    self.splatRanges = gpu.storage(16 * n);
    self.depthPlan = gpu.storageFrom(Plan.sort(n));
    self.offsetPlan = gpu.storageFrom(Plan.scan(n));
    self.tilePlan = gpu.storage(PLAN_BYTES);
    self.byDepth = sorter.sortBuffers(gpu, n);
    self.offsetScan = sorter.scanBuffers(gpu, n);
    self.noDepth = gpu.storage(16);
    return self;
  }

  // Room for an image and for intersections.
  fit(width, height, room) {
    const tiles = ceil(width, TILE) * ceil(height, TILE);
    const wanted = Math.max(room ?? 0, 4 * this.count + 64 * tiles);
    if (wanted > this.room) {
      this.room = wanted;
      this.byTile = this.sorter.sortBuffers(this.gpu, wanted);
      this.owners = this.gpu.storage(4 * wanted);
    }
    if (this.width !== width || this.height !== height) {
      Object.assign(this, { width, height, tiles });
      this.lists = this.gpu.storage(16 * tiles);
      this.image = this.gpu.storage(16 * width * height);
      this.stops = this.gpu.storage(4 * width * height);
    }
    return this.room;
  }

  record(commands, projector) {
    const { view, splats } = projector;
    const { byDepth, byTile, depthPlan, offsetPlan, tilePlan } = this;
    const groups = ceil(this.count, THREADS);
    commands.dispatch(this.intersect, [view, splats, this.counts, byDepth.keys, byDepth.values], groups);
    this.sorter.sort(commands, depthPlan, byDepth, 32, this.count);
    commands.dispatch(this.order, [view, this.counts, byDepth.values, this.offsets], groups);
    this.sorter.scan(commands, offsetPlan, this.offsets, this.offsetScan);
    commands.dispatch(this.emit, [view, splats, this.counts, byDepth.values, this.offsets, this.splatRanges, byTile.keys, byTile.values, this.owners], groups);
    commands.dispatch(this.planTiles, [view, offsetPlan, tilePlan], 1);
    this.sorter.sort(commands, tilePlan, byTile, 32 - Math.clz32(this.tiles));
    commands.clear(this.lists);
    commands.dispatchIndirect(this.ranges, [view, tilePlan, byTile.keys, this.lists], tilePlan, BLOCK_GROUPS);
    commands.dispatch(this.blend, [view, splats, byTile.values, this.owners, this.lists, this.image, this.noDepth, this.stops], this.tiles);
  }

  // Intersections that the last frame wanted: more than `room` means that some were left out.
  async wanted() { return (await this.gpu.read(this.offsetPlan, Uint32Array, 13))[12]; }
}

// Bits of the keys of depth_keys.wgsl.
export const KEY_BITS = 16;
// Quads that an instance draws.
const BATCH = 128;
// What quads show.
const LOOKS = { colours: 0, depth: 1, ellipsoids: 2 };

export class Quads {
  static async make(gpu, texts, sorter, scene, format) {
    const self = new Quads();
    const [view, splat, keys, quads] = await Promise.all([texts.train(part('shared/view')), texts.train(part('shared/splat')), texts.own('depth_keys.wgsl'), texts.own('quads.wgsl')]);
    Object.assign(self, { gpu, sorter, format, count: scene.count, parts: [view, splat, quads], passes: new Map() });
    const constants = `const THREADS = ${THREADS}u;\nconst BATCH = ${BATCH}u;`;
    [self.keys] = await Promise.all([gpu.kernel('depth keys', [constants, view, splat, keys]), self.prepare('colours')]);
    self.plan = gpu.storageFrom(Plan.sort(scene.count));
    self.byDepth = sorter.sortBuffers(gpu, scene.count);
    self.draw = gpu.storage(32);
    self.depths = gpu.uniform(16);
    self.range = gpu.uniform(16);
    self.indices = gpu.device.createBuffer({ size: 12 * BATCH, usage: GPUBufferUsage.INDEX | GPUBufferUsage.COPY_DST });
    gpu.upload(self.indices, Uint16Array.from({ length: 6 * BATCH }, (_, k) => 4 * Math.floor(k / 6) + [0, 1, 2, 2, 1, 3][k % 6]));
    return self;
  }

  // Makes what a look needs.
  async prepare(look) {
    if (this.passes.has(look)) return;
    const { gpu, format } = this;
    const over = { srcFactor: 'one', dstFactor: 'one-minus-src-alpha', operation: 'add' };
    const code = [`const BATCH = ${BATCH}u;\nconst LOOK = ${LOOKS[look]}u;`, ...this.parts].join('\n');
    const pipeline = await gpu.kept('quads', code, (module) => gpu.device.createRenderPipelineAsync({
      label: 'quads', layout: 'auto',
      vertex: { module, entryPoint: 'corner' },
      fragment: { module, entryPoint: 'shade', targets: [{ format, blend: { color: over, alpha: over } }] },
      primitive: { topology: 'triangle-list' },
    }), format);
    this.passes.set(look, { label: 'quads', pipeline, layout: pipeline.getBindGroupLayout(0), groups: new Map() });
  }

  // What the order is by; `range`: the nearest and the furthest depth there can be.
  recordKeys(commands, projector, [near, far]) {
    const { view, splats } = projector;
    this.gpu.upload(this.range, Float32Array.of(Math.log2(near), 65534 / Math.log2(Math.max(2, far / near)), 0, 0));
    this.gpu.upload(this.draw, Uint32Array.of(6 * BATCH, 0, 0, 0, 0, 0));
    commands.dispatch(this.keys, [view, splats, this.byDepth.keys, this.byDepth.values, this.draw, this.range], ceil(this.count, THREADS));
  }

  recordOrder(commands) { this.sorter.sort(commands, this.plan, this.byDepth, KEY_BITS, this.count); }

  // The same order, found by this program, of keys that were submitted.
  async order() { return sorted(await this.gpu.read(this.byDepth.keys, Uint32Array, this.count), KEY_BITS); }

  // `look`: what is shown; `depths`: between which colours tell depths apart.
  record(commands, projector, target, background, { look, depths }) {
    const { view, splats } = projector;
    this.gpu.upload(this.depths, Float32Array.from([...depths, 0, 0]));
    const shown = this.passes.get(look);
    const group = this.gpu.bindGroup(shown, [view, splats, this.byDepth.values, this.depths]);
    const [r, g, b] = background;
    const pass = commands.encoder.beginRenderPass({
      label: 'quads',
      colorAttachments: [{ view: target, loadOp: 'clear', storeOp: 'store', clearValue: { r, g, b, a: 1 } }],
    });
    pass.setPipeline(shown.pipeline);
    pass.setBindGroup(0, group);
    pass.setIndexBuffer(this.indices, 'uint16');
    pass.drawIndexedIndirect(this.draw, 0);
    pass.end();
  }
}

// What a rasteriser leaves to a texture: an image buffer (vec4f a pixel), or a texture that is larger in precision.
export class Blit {
  static async make(gpu, texts, format, text) {
    const self = new Blit();
    self.pipeline = await gpu.kept(text, await texts.own(text), (module) => gpu.device.createRenderPipelineAsync({
      label: text, layout: 'auto', vertex: { module, entryPoint: 'corner' },
      fragment: { module, entryPoint: 'shade', targets: [{ format }] }, primitive: { topology: 'triangle-list' },
    }), format);
    self.gpu = gpu;
    return self;
  }

  // `image`: what it was made from last is kept; `resources` are its bindings.
  record(commands, image, resources, target) {
    if (this.image !== image) {
      const entries = resources().map((resource, binding) => ({ binding, resource }));
      this.group = this.gpu.device.createBindGroup({ layout: this.pipeline.getBindGroupLayout(0), entries });
      this.image = image;
    }
    const pass = commands.encoder.beginRenderPass({
      label: 'blit',
      colorAttachments: [{ view: target, loadOp: 'clear', storeOp: 'store', clearValue: { r: 0, g: 0, b: 0, a: 1 } }],
    });
    pass.setPipeline(this.pipeline);
    pass.setBindGroup(0, this.group);
    pass.draw(3);
    pass.end();
  }
}
