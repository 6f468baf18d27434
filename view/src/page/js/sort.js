// The host side of splat/src/sort: prefix sums and the radix sort, on the trainer's own WGSL; and a sort by this program.

const BLOCK = 2048;
const DIGITS = 16;
export const BLOCK_GROUPS = 16;
const SCAN_GROUPS = 32;
// As many numbers one workgroup adds up while three kernels would still be waiting for each other.
const FEW = 8 * BLOCK;
export const PLAN_BYTES = 64;

const blocks = (count) => Math.ceil(count / BLOCK);
const groups = (count) => (count > 65535 ? [32768, Math.ceil(count / 32768), 1, 0] : [count, 1, 1, 0]);

export const Plan = {
  scan: (count) => Uint32Array.of(0, 0, count, blocks(count), 0, 0, 0, 0, ...groups(blocks(count)), 0, 0, 0, 0),
  sort(count) {
    const plan = Plan.scan(DIGITS * blocks(count));
    plan.set([count, blocks(count)], 0);
    plan.set(groups(blocks(count)), 4);
    return plan;
  },
};

export class Sorter {
  constructor(gpu, texts) {
    Object.assign(this, { gpu, texts });
    this.shifts = Array.from({ length: 8 }, (_, pass) => gpu.uniformFrom(Uint32Array.of(4 * pass, 0, 0, 0)));
  }

  // Makes the kernels, which a processor compiles for a second, and which fast pictures do without there.
  async prepare() {
    const { gpu, texts } = this;
    const text = (name) => texts.train(`sort/${name}.wgsl`);
    const [shared, scan, reduce, sums, apply, whole, count, scatter] = await Promise.all(
      ['shared', 'scan_shared', 'scan_reduce', 'scan_sums', 'scan_apply', 'scan_whole', 'radix_count', 'radix_scatter'].map(text));
    const k = (label, ...parts) => gpu.kernel(label, [shared, ...parts]);
    [this.reduce, this.sums, this.apply, this.whole, this.count, this.scatter] = await Promise.all([
      k('scan reduce', scan, reduce), k('scan sums', scan, sums), k('scan apply', scan, apply), k('scan whole', scan, whole),
      k('radix count', count), k('radix scatter', scatter)]);
  }

  scanBuffers(gpu, count) { return gpu.storage(4 * blocks(count)); }

  sortBuffers(gpu, capacity) {
    const pairs = () => gpu.storage(4 * capacity);
    const counts = DIGITS * blocks(capacity);
    return { keys: pairs(), values: pairs(), otherKeys: pairs(), otherValues: pairs(), counts: gpu.storage(4 * counts), few: counts <= FEW, scan: this.scanBuffers(gpu, counts) };
  }

  scan(commands, plan, numbers, sums) {
    commands.dispatchIndirect(this.reduce, [plan, numbers, sums], plan, SCAN_GROUPS);
    commands.dispatch(this.sums, [plan, sums], 1);
    commands.dispatchIndirect(this.apply, [plan, sums, numbers], plan, SCAN_GROUPS);
  }

  // By the lowest `bits` bits, in place; `known`: how many there are, where that is known here.
  sort(commands, plan, b, bits, known) {
    const passes = Math.min(8, 2 * Math.ceil(Math.ceil(bits / 4) / 2));
    const byBlock = (kernel, bindings) => (known === undefined
      ? commands.dispatchIndirect(kernel, bindings, plan, BLOCK_GROUPS) : commands.dispatch(kernel, bindings, blocks(known)));
    for (let pass = 0; pass < passes; pass++) {
      const [from, fromValues, to, toValues] = pass % 2
        ? [b.otherKeys, b.otherValues, b.keys, b.values] : [b.keys, b.values, b.otherKeys, b.otherValues];
      byBlock(this.count, [plan, this.shifts[pass], from, b.counts]);
      if (b.few) commands.dispatch(this.whole, [plan, b.counts], 1);
      else this.scan(commands, plan, b.counts, b.scan);
      byBlock(this.scatter, [plan, this.shifts[pass], from, fromValues, b.counts, to, toValues]);
    }
  }
}

// Indices in the order of their keys of `bits` bits; equal keys keep their order.
export function sorted(keys, bits) {
  const places = new Uint32Array(2 ** bits + 1);
  for (const key of keys) places[key + 1]++;
  for (let key = 1; key < places.length; key++) places[key] += places[key - 1];
  const order = new Uint32Array(keys.length);
  for (let k = 0; k < keys.length; k++) order[places[keys[k]]++] = k;
  return order;
}
