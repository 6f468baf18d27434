// How the numbers of a section are written, and what is said of a file that is not as it should be.

export const FOREIGN = 'This is no scene of erfgs, or one of a later version.';
export const DAMAGED = 'The scene is damaged: reload the page, or export it again.';
export const CUT_OFF = 'The scene is cut off: reload the page, or export it again.';

export const isCount = (value) => Number.isSafeInteger(value) && value >= 0;
export const need = (holds, what = DAMAGED) => { if (!holds) throw new Error(what); };

// Bytes of a section.
export function sizeOf(coding, floats) {
  if (coding.kind === 'exact') return 4 * floats;
  if (coding.kind === 'half' || coding.kind === 'whole') return 2 * floats;
  need(coding.kind === 'blocks', FOREIGN);
  const { rows, columns } = coding;
  const count = floats / columns.length;
  need(isCount(rows) && rows > 0 && isCount(count) && columns.every((size) => size === 0 || size === 1 || size === 2));
  return Math.ceil(count / rows) * 8 * columns.length + count * columns.reduce((sum, size) => sum + size, 0);
}

export const READERS = {
  exact: (bytes) => new Float32Array(bytes.buffer),

  half: (bytes, floats) => Float32Array.from(new Uint16Array(bytes.buffer, 0, floats), (code) => {
    const [exponent, fraction] = [code >> 10 & 31, code & 1023];
    const size = exponent === 0 ? fraction * 2 ** -24 : (1024 + fraction) * 2 ** (exponent - 25);
    return code >> 15 ? -size : size;
  }),

  // Whole numbers.
  whole: (bytes, floats) => Float32Array.from(new Uint16Array(bytes.buffer, 0, floats)),

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
