// The line of time: exposures of the frames, the rate of events, where windows of a take meet, the range that is repeated, and the instant that is shown.

const COLOURS = { ground: '#23262d', events: '#58708a', frames: '#d9a441', range: 'rgba(120, 170, 255, 0.18)', cut: '#8a6fb0', now: '#ffffff', error: '#7fd18b', text: '#d9dde4' };

export class Timeline {
  constructor(canvas, header, moved) {
    Object.assign(this, { canvas, header, range: [0, 1] });
    const at = (event) => {
      const box = canvas.getBoundingClientRect();
      return Math.min(1, Math.max(0, (event.clientX - box.left) / Math.max(1, box.width)));
    };
    canvas.addEventListener('pointerdown', (down) => { canvas.setPointerCapture(down.pointerId); this.drag = true; moved(at(down)); });
    canvas.addEventListener('pointermove', (move) => { if (this.drag) moved(at(move)); });
    for (const kind of ['pointerup', 'pointercancel']) canvas.addEventListener(kind, () => { this.drag = false; });
    // The instants of all frames, each once.
    const times = header.cameras.flatMap((camera) => camera.frames);
    this.exposures = [...new Map(times.map((frame) => [frame.join(), frame])).values()].sort((a, b) => a[0] - b[0]);
    this.most = Math.max(1e-9, ...header.events.counts.map((count, k) => count / this.#length(k)));
  }

  #length(bin) { return Math.max(1e-9, this.header.events.edges[bin + 1] - this.header.events.edges[bin]); }

  // PSNR of the frames of a camera, or of all held-out ones at each instant, where it was measured.
  measured(errors, camera) {
    const own = errors.filter((error) => error.camera === camera);
    const at = new Map();
    for (const { t01, psnr_db } of own.length ? own : errors) at.set(t01, [...at.get(t01) ?? [], psnr_db]);
    this.psnr = [...at].map(([t, values]) => [t, values.reduce((a, b) => a + b) / values.length]).sort((a, b) => a[0] - b[0]);
  }

  #errors(paint, width, height, ratio) {
    if (!this.psnr?.length) return;
    const values = this.psnr.map(([, value]) => value);
    const [low, high] = [Math.min(...values), Math.max(...values)];
    paint.strokeStyle = paint.fillStyle = COLOURS.error;
    paint.lineWidth = 1.5 * ratio;
    paint.beginPath();
    for (const [t, value] of this.psnr) paint.lineTo(t * width, height * (0.95 - 0.7 * (value - low) / Math.max(1e-9, high - low)));
    paint.stroke();
    paint.font = `${10 * ratio}px system-ui, sans-serif`;
    paint.fillText(`PSNR ${low.toFixed(1)} to ${high.toFixed(1)} dB`, 4 * ratio, height - 4 * ratio);
  }

  draw(t01) {
    const { canvas } = this;
    const ratio = devicePixelRatio || 1;
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const paint = canvas.getContext('2d');
    const bar = (from, to, top, bottom, colour, least = 1) => {
      paint.fillStyle = colour;
      paint.fillRect(from * width, top * height, Math.max(least, (to - from) * width), (bottom - top) * height);
    };
    bar(0, 1, 0, 1, COLOURS.ground);
    const { edges, counts } = this.header.events;
    counts.forEach((count, k) => bar(edges[k], edges[k + 1], 1 - 0.8 * count / this.#length(k) / this.most, 1, COLOURS.events));
    for (const [t, from, to] of this.exposures) bar(to > from ? from : t, to, 0, 0.18, COLOURS.frames, ratio);
    for (const cut of this.header.cuts ?? []) bar(cut, cut, 0.18, 1, COLOURS.cut, ratio);
    const [from, to] = this.range;
    if (from > 0 || to < 1) bar(from, to, 0, 1, COLOURS.range);
    this.#errors(paint, width, height, ratio);
    bar(t01, t01, 0, 1, COLOURS.now, 2 * ratio);
  }
}
