// A run that is being trained: its curves, what it does, and its buttons.

const EVERY_MS = 1500;
const COLOURS = { loss: '#97a1b0', psnr: '#d9a441', dpsnr: '#7fb2ff', line: '#30343d', text: '#97a1b0' };
const clock = (seconds) => (seconds >= 60 ? `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s` : `${Math.round(seconds)} s`);

export class Training {
  // `panel`: where it is shown; `renewed` is called when there is a new scene, and waited for.
  constructor(panel, renewed) {
    Object.assign(this, { panel, renewed, rows: [], version: 0 });
    this.part = (name) => panel.querySelector(`[data-part="${name}"]`);
    panel.hidden = false;
    for (const wish of ['save', 'stop']) {
      this.part(wish).addEventListener('click', async () => {
        if (wish === 'stop' && !confirm('Stop the training? A checkpoint is kept, and the training can continue later.')) return;
        this.part(wish).disabled = true;
        const answer = await fetch(`api/training/${wish}`, { method: 'POST' }).catch((error) => ({ ok: false, text: () => error.message }));
        if (!answer.ok) this.part('wish').textContent = `The server says: ${await answer.text()}`;
        else this.part('wish').textContent = wish === 'save' ? 'a checkpoint is being saved' : 'it stops after this iteration';
      });
    }
  }

  // Asks again and again until the training ends.
  async follow() {
    for (;;) {
      try {
        const answer = await fetch(`api/training?rows=${this.rows.length}`);
        if (!answer.ok) throw new Error(await answer.text());
        const state = await answer.json();
        this.rows.push(...state.rows);
        this.show(state);
        // A page that nobody sees needs no new scene.
        if (state.version !== this.version && (!document.hidden || state.ended)) {
          await this.renewed();
          this.version = state.version;
          this.panel.dataset.version = this.version;
        }
        if (state.ended) return;
      } catch (error) {
        // A program that ended answers no more; one that is busy does so later.
        this.missed = (this.missed ?? 0) + 1;
        if (this.missed > 5) {
          this.part('now').textContent = `The program does not answer any more (${error.message}). The last scene is still shown.`;
          for (const wish of ['save', 'stop']) this.part(wish).disabled = true;
          return;
        }
      }
      await new Promise((done) => { setTimeout(done, EVERY_MS); });
    }
  }

  show({ now, left_seconds: left, left_out: leftOut, saved, ended }) {
    this.missed = 0;
    if (now) {
      const parts = [`${now.stage} iteration ${now.iteration.toLocaleString('en')} of ${now.iterations.toLocaleString('en')}`,
        `${now.gaussians.toLocaleString('en')} Gaussians, ${now.dynamic.toLocaleString('en')} move`, clock(now.seconds)];
      if (ended) parts.push(ended);
      else if (left != null) parts.push(`${clock(left)} left`);
      this.part('now').textContent = parts.join(' · ');
    }
    if (saved != null && saved !== this.saved) {
      this.saved = saved;
      this.part('wish').textContent = `a checkpoint was saved after iteration ${saved.toLocaleString('en')}`;
      this.part('save').disabled = false;
    }
    if (ended) {
      for (const wish of ['save', 'stop']) this.part(wish).disabled = true;
      this.part('wish').textContent = '';
    }
    const details = this.part('leftout').parentElement;
    details.hidden = leftOut.length === 0;
    details.firstElementChild.textContent = `Left out: ${leftOut.length === 1 ? 'one thing that' : `${leftOut.length} things that`} the scene does not need`;
    this.part('leftout').textContent = leftOut.join('; ');
    this.#draw();
  }

  // Loss on a logarithmic axis, PSNR on a linear one, both against the time of training.
  #draw() {
    const canvas = this.part('curves');
    const ratio = devicePixelRatio || 1;
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (!width) return;
    Object.assign(canvas, { width, height });
    const paint = canvas.getContext('2d');
    const edge = 3 * ratio;
    const curve = (name) => this.rows.filter((row) => row[name] != null).map((row) => [row.seconds, row[name]]);
    const last = Math.max(1e-9, this.rows.at(-1)?.seconds ?? 0);
    paint.font = `${11 * ratio}px system-ui, sans-serif`;
    const plot = (curves, top, bottom, scale, unit) => {
      const values = curves.flatMap(([points]) => points.map(([, value]) => scale(value)));
      const [low, high] = [Math.min(...values), Math.max(...values)];
      paint.strokeStyle = COLOURS.line;
      paint.strokeRect(0.5, top + 0.5, width - 1, bottom - top - 1);
      let at = width - edge;
      for (const [points, colour, name] of curves.toReversed()) {
        if (points.length === 0) continue;
        const y = (value) => bottom - edge - (scale(value) - low) / Math.max(1e-9, high - low) * (bottom - top - 2 * edge);
        paint.strokeStyle = paint.fillStyle = colour;
        paint.lineWidth = 1.5 * ratio;
        paint.beginPath();
        for (const [seconds, value] of points) paint.lineTo(edge + seconds / last * (width - 2 * edge), y(value));
        paint.stroke();
        const label = `${name} ${points.at(-1)[1].toPrecision(4)}${unit}`;
        at -= paint.measureText(label).width;
        paint.fillText(label, at, bottom - 2 * edge);
        at -= 4 * edge;
      }
    };
    const gap = 4 * ratio;
    plot([[curve('loss_rgb'), COLOURS.loss, 'loss']], 0, (height - gap) / 2, Math.log, '');
    plot([[curve('psnr'), COLOURS.psnr, 'PSNR'], [curve('dpsnr'), COLOURS.dpsnr, 'moving']], (height + gap) / 2, height, (value) => value, ' dB');
  }
}
