// What a camera recorded, beside the rendering: the frame that is nearest in time, and its events.

import * as source from './source.js';

export class Recorded {
  // `image`: where frames are shown; `changed` is called when events came that were waited for.
  constructor(image, changed) { Object.assign(this, { image, changed }); }

  // Shows a frame of `camera`: `kind` is `over`, `difference` or nothing.
  frame(camera, t01, kind, opacity) {
    this.image.hidden = !kind;
    if (!kind) return;
    const away = ([t, from, to]) => (t01 >= from && t01 <= to ? 0 : Math.abs(t - t01));
    const nearest = camera.frames.reduce((best, frame, k) => (away(frame) < away(camera.frames[best]) ? k : best), 0);
    // A frame of a take tells its model, and its number there.
    const [,,, model = 0, index = nearest] = camera.frames[nearest];
    const url = `api/frame/${model}/${encodeURIComponent(camera.name)}/${index}`;
    if (this.image.getAttribute('src') !== url) this.image.src = url;
    this.image.className = kind;
    this.image.style.opacity = kind === 'over' ? opacity : 1;
  }

  // Events of `camera` of a model in a range of its time, or nothing while they are being fetched. One request at a time: what is asked for
  // meanwhile is asked for again when it is there.
  events(model, camera, from, to) {
    const key = `${model}/${encodeURIComponent(camera.name)}?${new URLSearchParams({ from: from.toFixed(7), to: to.toFixed(7) })}`;
    if (this.key === key) return this.packed;
    if (!this.asking) {
      this.asking = source.bytes(`api/events/${key}`).then((buffer) => Object.assign(this, { key, packed: new Uint16Array(buffer) }))
        .catch(() => Object.assign(this, { key, packed: null })).finally(() => { this.asking = null; this.changed(); });
    }
    return null;
  }
}
