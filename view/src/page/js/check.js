// Whether this browser shows what the trainer would: pictures of cameras of the rig, drawn here and by the server.

import { request } from './pictures.js';
import { preset } from './camera.js';

// Camera k of `count` at a time of its own, in both ways of drawing; tells each result.
export async function check(painter, model, header, count, told) {
  const cameras = header.cameras.filter((_, k) => k % Math.ceil(header.cameras.length / count) === 0);
  for (const [k, camera] of cameras.entries()) {
    // Not the ends alone: there, clamping hides errors.
    const t01 = (k + 0.5) / cameras.length;
    for (const mode of ['tiles', 'quads']) {
      const view = { ...preset(camera, [camera.width, camera.height]), near: camera.near };
      const body = await painter.pixels(view, t01, { mode });
      const response = await fetch(request('compare', model, view, t01, { camera: camera.name, mode }), { method: 'POST', body });
      if (!response.ok) throw new Error(`The server says: ${await response.text()}`);
      told(await response.json());
    }
  }
}
