// The models of a page: what was learned, as far as it is there, and who draws it.

import { NoGpu, NoRoom, open } from './gpu.js';
import { SceneReader } from './scene.js';
import * as source from './source.js';
import { Drawn, Sent } from './pictures.js';

const TEXTS = { train: (name) => source.text(`train/${name}`), own: (name) => source.text(`wgsl/${name}`) };
// A device that is lost again so soon is not taken up once more.
const LOST_AGAIN_MS = 20_000;
// How often, and how long after the last time, one is asked for.
const RECOVER_TRIES = 5;
const RECOVER_MS = 1000;

// The device that draws, or why the server must.
async function device(abouts, wanted) {
  const beyond = abouts.find((about) => about.only_server);
  const alone = isAlone(abouts);
  if (beyond && alone) throw new Error(`A browser cannot draw ${beyond.name}: ${beyond.only_server}. Use erfgs view with its run.`);
  if (wanted === 'server' && !alone) return { why: 'as asked for in the address' };
  if (beyond) return { why: `the browser cannot draw ${beyond.name}: ${beyond.only_server}` };
  try {
    const gpu = await open(navigator.gpu);
    if (gpu.adapter.info?.isFallbackAdapter && wanted !== 'webgpu' && !alone) return { why: 'this browser has no GPU, only a slow software renderer' };
    return { gpu };
  } catch (error) {
    if (alone || !(error instanceof NoGpu)) throw error;
    return { why: error.message };
  }
}

// Whether there is no server that draws them.
const isAlone = (abouts) => source.alone || abouts.some((about) => !about.from_run);

// Of the windows of a take, so many are kept: the one that is seen, the next, and those before.
const KEPT = 4;

export class Models {
  // Resolves once each of the models `first` has something to show; `whole` then waits for all of these. `canvases`: one for each model;
  // `wanted`: `webgpu`, `server` or nothing. `told` hears how much of all is there, and `changed` that there is more to draw.
  static async load(abouts, canvases, wanted, first, told, changed) {
    const self = new Models();
    Object.assign(self, { abouts, canvases, told, changed, shares: new Map(), loads: new Map(), list: [] }, await device(abouts, wanted));
    self.whole = Promise.all(first.map((k) => self.#load(k).rest));
    // Who waits for the first picture is told of what failed.
    self.whole.catch(() => {});
    await Promise.all(first.map((k) => self.#load(k).first));
    return self;
  }

  // Loads a model anew: it has learned more.
  async renew(k) { await this.#follow(k, Infinity).rest; }

  // A model as far as it is there; nothing until it can be shown. It is loaded if it was not, for which others may have to go.
  want(k) {
    const load = this.#load(k);
    // The last that was wanted comes last.
    this.loads.delete(k);
    this.loads.set(k, load);
    if (load.failed) {
      // When it is wanted again, it is tried again.
      this.loads.delete(k);
      throw load.failed;
    }
    return this.list[k];
  }

  // The same, once all of it is there.
  async all(k) {
    await this.#load(k).rest;
    return this.list[k];
  }

  #load(k) {
    if (!this.loads.has(k)) {
      const load = this.#follow(k);
      load.first.then(() => this.changed(), () => {});
      load.rest.then(() => this.#forget(), (error) => { load.failed = error; this.changed(); });
      this.loads.set(k, load);
      this.#forget();
    }
    return this.loads.get(k);
  }

  // Lets go of all that are whole but those that were wanted last.
  #forget() {
    const before = [...this.loads.keys()].slice(0, -KEPT);
    for (const k of before.filter((other) => this.list[other]?.scene.whole)) {
      this.list[k].painter.viewer?.destroy();
      delete this.list[k];
      this.loads.delete(k);
      this.shares.delete(k);
    }
  }

  // Shows a model as it comes, from `least` of it on.
  #follow(k, least = this.gpu ? 2 : 1) {
    const reader = new SceneReader(this.abouts[k].bytes);
    const fetched = async () => {
      for await (const bytes of source.scene(k)) {
        reader.push(bytes);
        this.shares.set(k, reader.share);
        this.told(Math.min(...this.shares.values()));
      }
    };
    fetched().then(() => reader.end(), (error) => reader.end(error));
    const first = reader.better(least).then((scene) => this.#show(k, scene).then(() => scene));
    const rest = first.then(async (scene) => {
      for (let last = scene; !last.whole; this.changed()) {
        last = await reader.better();
        await this.#show(k, last);
      }
    });
    return { first, rest };
  }

  async #show(k, scene) {
    const before = this.list[k];
    if (this.gpu) {
      try {
        const painter = await Drawn.make(this.gpu, TEXTS, scene, this.canvases[k]);
        this.list[k] = { scene, painter };
        before?.painter.viewer?.destroy();
        return;
      } catch (error) {
        if (isAlone(this.abouts) || !(error instanceof NoRoom)) throw error;
        this.#leave(error.message);
      }
    }
    this.list[k] = { scene, painter: before?.painter instanceof Sent ? before.painter : new Sent(k, this.canvases[k]) };
  }

  // From now on the server draws. A canvas has one kind of context for all its life.
  #leave(why) {
    for (const { painter } of this.list.filter(Boolean)) painter.viewer?.destroy();
    Object.assign(this, { gpu: null, why });
    const others = new Map([...new Set(this.canvases)].map((canvas) => [canvas, canvas.cloneNode()]));
    others.forEach((other, canvas) => canvas.replaceWith(other));
    this.canvases = this.canvases.map((canvas) => others.get(canvas));
    this.list.forEach((shown, k) => { shown.painter = new Sent(k, this.canvases[k]); });
  }

  // Takes the device up again after it was lost. Gives whether that was worth trying.
  async recover() {
    if (performance.now() - (this.recovered ?? -LOST_AGAIN_MS) < LOST_AGAIN_MS) return false;
    this.recovered = performance.now();
    for (let tries = 1; ; tries++) {
      try {
        this.gpu = await open(navigator.gpu);
        break;
      } catch (error) {
        // A driver that is starting again has no adapter for a while.
        if (tries === RECOVER_TRIES) throw error;
        await new Promise((done) => { setTimeout(done, RECOVER_MS); });
      }
    }
    for (const k of Object.keys(this.list)) this.list[k].painter = await Drawn.make(this.gpu, TEXTS, this.list[k].scene, this.canvases[k]);
    return true;
  }
}
