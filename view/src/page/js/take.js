// One line of time for what is shown: of a run, or of the windows of a long take, which are shown one after another.

import { need } from './codings.js';

export class Take {
  // `abouts`: what is known of the models before they are loaded. Those of a take say which part of it they are of, in seconds.
  constructor(abouts) {
    this.long = Boolean(abouts[0].window);
    if (!this.long) return;
    this.windows = abouts.map(({ window: { span_ns: [start, end], ...of } }, model) => ({ ...of, model, length: (end - start) / 1e9 }));
    need(this.windows.every(({ length, from, until }, k, all) => length > 0 && until > from && (k === 0 || from >= all[k - 1].until - 1e-6)));
    this.start = this.windows[0].from;
    this.seconds = this.windows.at(-1).until - this.start;
  }

  // Which model shows the instant `t01`, the number of its window, and the same instant on its own line of time. What is between windows
  // that are there is shown by the one before.
  at(t01) {
    if (!this.long) return { model: 0, number: 0, t01 };
    const seconds = this.start + t01 * this.seconds;
    const number = Math.max(0, this.windows.findLastIndex(({ from }) => seconds >= from));
    const { begins, until, length, model } = this.windows[number];
    return { model, number, t01: Math.min(1, Math.max(0, (Math.min(seconds, until) - begins) / length)) };
  }

  // The model that comes next.
  after(number) { return this.long ? this.windows[number + 1]?.model : undefined; }

  // An instant of a window's own line of time.
  #share({ begins, length }, t01) { return (begins + t01 * length - this.start) / this.seconds; }

  // What is said of the whole, given the header of one model. A frame of a take tells its model, and its number there.
  header(header) {
    if (!this.long) return header;
    const edgesOf = ({ from, until }) => [from, until].map((seconds) => (seconds - this.start) / this.seconds);
    const frames = (name) => this.windows.flatMap((window) => {
      const [from, until] = edgesOf(window);
      const own = (window.frames[name] ?? []).map((times, index) => [...times.map((t) => this.#share(window, t)), window.model, index]);
      return own.filter(([t]) => t >= from - 1e-9 && t < until + 1e-9);
    });
    const events = { edges: [0], counts: [] };
    const bin = (to, count) => {
      if (to <= events.edges.at(-1)) return;
      events.edges.push(to);
      events.counts.push(count);
    };
    for (const window of this.windows) {
      const [from, until] = edgesOf(window);
      bin(from, 0);
      const { edges, counts } = window.events;
      counts.forEach((count, k) => {
        const [low, high] = [edges[k], edges[k + 1]].map((t) => this.#share(window, t));
        const [left, right] = [Math.max(low, from, events.edges.at(-1)), Math.min(high, until)];
        if (right > left) bin(right, count * (right - left) / (high - low));
      });
    }
    bin(1, 0);
    const cameras = header.cameras.map((camera) => ({ ...camera, frames: frames(camera.name) }));
    const start = Math.round(this.start * 1e9);
    const cuts = this.windows.slice(1).map((window) => edgesOf(window)[0]);
    return { ...header, cameras, cuts, events: events.counts.some(Boolean) ? events : { edges: [], counts: [] }, span_ns: [start, start + Math.round(this.seconds * 1e9)] };
  }

  // What was measured of the frames of all models, on this line of time.
  errors(measured) {
    if (!this.long) return measured[0];
    return this.windows.flatMap((window) => measured[window.model]
      .map((error) => ({ ...error, t01: this.#share(window, error.t01) }))
      .filter(({ t01 }) => this.at(t01).model === window.model));
  }
}
