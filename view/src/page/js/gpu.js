// Device, kernels and dispatches: what the trainer's `gpu` does, for a browser.

// What is wanted beyond WebGPU's guaranteed limits: blending by tiles takes 16,416 bytes of workgroup memory instead of 16,384, and
// large scenes take bindings of more than 128 MiB.
const WANTED = ['maxStorageBuffersPerShaderStage', 'maxComputeWorkgroupStorageSize', 'maxStorageBufferBindingSize', 'maxBufferSize'];

// Why a browser cannot draw, in words for its user.
export class NoGpu extends Error {}
// Why a device cannot draw a scene.
export class NoRoom extends Error {}

const mega = (bytes) => `${Math.ceil(bytes / 1e6).toLocaleString('en')} MB`;

export async function open(gpu) {
  if (!gpu) {
    throw new NoGpu(globalThis.isSecureContext === false
      ? 'This page was not loaded from localhost or over https, and browsers offer WebGPU only there. On the machine where you sit, '
        + 'run ssh -L 8200:localhost:8200 HOST and open the link with localhost in it.'
      : 'This browser has no WebGPU: take a current Chrome, Edge, Safari or Firefox, or switch it on.');
  }
  const adapter = await gpu.requestAdapter({ powerPreference: 'high-performance' });
  if (!adapter) throw new NoGpu('This browser has WebGPU, but no graphics adapter for it: check that its settings enable the graphics processor.');
  const requiredLimits = Object.fromEntries(WANTED.map((name) => [name, adapter.limits[name]]));
  return new Gpu(await adapter.requestDevice({ requiredLimits }), adapter);
}

// Whether an adapter computes on the processor, as its browser says or by its name: many short passes are slow there.
export function onProcessor({ isFallbackAdapter, info = {} }) {
  const name = [info.vendor, info.architecture, info.device, info.description].join(' ');
  return Boolean(isFallbackAdapter ?? info.isFallbackAdapter) || /swiftshader|llvmpipe|lavapipe|softpipe|basic render/i.test(name);
}

export class Gpu {
  constructor(device, adapter) {
    Object.assign(this, { device, adapter, errors: [], compiled: new Map(), onProcessor: onProcessor(adapter) });
    device.addEventListener?.('uncapturederror', (event) => this.errors.push(event.error.message));
  }

  // What `make` gives, which takes memory of the device: `bytes` in its largest buffer.
  async withRoom(what, bytes, make) {
    const { maxStorageBufferBindingSize, maxBufferSize } = this.device.limits;
    const most = Math.min(maxStorageBufferBindingSize, maxBufferSize);
    if (bytes > most) throw new NoRoom(`${what} take ${mega(bytes)} in one buffer, and the graphics device of this browser gives ${mega(most)}`);
    this.device.pushErrorScope('out-of-memory');
    const made = await make();
    if (await this.device.popErrorScope()) throw new NoRoom(`The graphics device has no memory left for ${what}: close what else uses it`);
    return made;
  }

  storage(bytes, data) {
    const size = Math.max(16, Math.ceil(bytes / 16) * 16);
    const usage = GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC | GPUBufferUsage.COPY_DST | GPUBufferUsage.INDIRECT;
    const buffer = this.device.createBuffer({ size, usage });
    if (data) this.upload(buffer, data);
    return buffer;
  }

  storageFrom(data) { return this.storage(data.byteLength, data); }

  uniform(bytes) {
    return this.device.createBuffer({ size: Math.ceil(bytes / 16) * 16, usage: GPUBufferUsage.UNIFORM | GPUBufferUsage.COPY_DST });
  }

  uniformFrom(data) { const buffer = this.uniform(data.byteLength); this.upload(buffer, data); return buffer; }

  upload(buffer, data, offset = 0) { this.device.queue.writeBuffer(buffer, offset, data); }

  // WGSL parts joined in order; entry point `main`; bindings in group 0, numbered from 0. What was compiled once is kept.
  async kernel(label, parts) {
    const pipeline = await this.kept(label, parts.join('\n'),
      (module) => this.device.createComputePipelineAsync({ label, layout: 'auto', compute: { module, entryPoint: 'main' } }));
    return { label, pipeline, layout: pipeline.getBindGroupLayout(0), groups: new Map() };
  }

  kept(label, code, make, variant = '') {
    const key = code + variant;
    if (!this.compiled.has(key)) this.compiled.set(key, make(this.device.createShaderModule({ label, code })));
    return this.compiled.get(key);
  }

  // Bind groups are kept: a viewer binds the same buffers in every frame.
  bindGroup(kernel, bindings) {
    const key = bindings.map((buffer) => (buffer.serial ??= ++serial)).join();
    let group = kernel.groups.get(key);
    if (!group) {
      const entries = bindings.map((buffer, binding) => ({ binding, resource: { buffer } }));
      group = this.device.createBindGroup({ label: kernel.label, layout: kernel.layout, entries });
      kernel.groups.set(key, group);
    }
    return group;
  }

  commands() { return new Commands(this); }

  async read(buffer, Kind, count) {
    const size = Math.ceil(count * Kind.BYTES_PER_ELEMENT / 4) * 4;
    const copy = this.device.createBuffer({ size, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
    const encoder = this.device.createCommandEncoder();
    encoder.copyBufferToBuffer(buffer, 0, copy, 0, size);
    this.device.queue.submit([encoder.finish()]);
    await copy.mapAsync(GPUMapMode.READ);
    const values = new Kind(copy.getMappedRange().slice(0), 0, count);
    copy.destroy();
    return values;
  }

  done() { return this.device.queue.onSubmittedWorkDone(); }
}

let serial = 0;

export class Commands {
  constructor(gpu) { Object.assign(this, { gpu, encoder: gpu.device.createCommandEncoder() }); }

  dispatch(kernel, bindings, groups) {
    if (groups === 0) return;
    this.#pass(kernel, bindings, (pass) => (groups > 65535
      ? pass.dispatchWorkgroups(32768, Math.ceil(groups / 32768)) : pass.dispatchWorkgroups(groups)));
  }

  dispatchIndirect(kernel, bindings, args, offset) {
    this.#pass(kernel, bindings, (pass) => pass.dispatchWorkgroupsIndirect(args, offset));
  }

  #pass(kernel, bindings, go) {
    const pass = this.encoder.beginComputePass({ label: kernel.label });
    pass.setPipeline(kernel.pipeline);
    pass.setBindGroup(0, this.gpu.bindGroup(kernel, bindings));
    go(pass);
    pass.end();
  }

  clear(buffer) { this.encoder.clearBuffer(buffer); }
  submit() { this.gpu.device.queue.submit([this.encoder.finish()]); }
}
