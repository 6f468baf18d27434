// Two ways to a picture: drawn here on WebGPU, or drawn by the server and sent.

import { Viewer, largest } from './viewer.js';
import { nearOf } from './scene.js';

const trainedNear = (scene, view) => view.near ?? nearOf(scene, view);

// The device that a canvas shows pictures of: to say it again takes the picture away that is there.
const configured = new WeakMap();

export class Drawn {
  static async make(gpu, texts, scene, canvas) {
    const self = new Drawn();
    const format = navigator.gpu.getPreferredCanvasFormat();
    const context = canvas.getContext('webgpu');
    if (configured.get(canvas) !== gpu.device) context.configure({ device: gpu.device, format, alphaMode: 'opaque' });
    configured.set(canvas, gpu.device);
    const what = `${scene.count.toLocaleString('en')} Gaussians`;
    const viewer = await gpu.withRoom(what, largest(scene), () => Viewer.make(gpu, texts, scene, format));
    Object.assign(self, { canvas, context, scene, viewer });
    return self;
  }

  // `how`: mode, look and layer (see `Viewer.frame`).
  async draw(view, t01, how) {
    const { canvas, context, viewer, scene } = this;
    if (canvas.width !== view.width || canvas.height !== view.height) Object.assign(canvas, { width: view.width, height: view.height });
    await viewer.prepare(how);
    // Meanwhile a better one may have taken its place.
    if (viewer.gone) return true;
    await viewer.frame(view, t01, () => context.getCurrentTexture().createView(), { ...how, near: trainedNear(scene, view) });
    if (viewer.gone) return true;
    await viewer.gpu.done();
    const error = viewer.gpu.errors.shift();
    if (error) throw new Error(`The graphics device says: ${error}`);
    return how.mode === 'tiles' && await viewer.lacked();
  }

  async pixels(view, t01, how) {
    await this.viewer.prepare(how);
    return this.viewer.pixels(view, t01, { ...how, near: trainedNear(this.scene, view) });
  }
}

export const request = (kind, model, { near, ...view }, t01, more = {}) =>
  `api/${kind}/${model}?${new URLSearchParams({ t01: String(t01), view: JSON.stringify(view), ...more })}`;

export class Sent {
  constructor(model, canvas) {
    Object.assign(this, { model, canvas, paint: canvas.getContext('2d') });
  }

  async draw(view, t01) {
    const response = await fetch(request('render', this.model, view, t01));
    if (!response.ok) throw new Error(`The server says: ${await response.text()}`);
    const picture = await createImageBitmap(await response.blob());
    Object.assign(this.canvas, { width: picture.width, height: picture.height });
    this.paint.drawImage(picture, 0, 0);
    return false;
  }

  async pixels(view, t01) {
    await this.draw(view, t01);
    return new Uint8Array(this.paint.getImageData(0, 0, this.canvas.width, this.canvas.height).data.buffer);
  }
}
