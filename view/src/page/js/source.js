// Where scenes and texts come from: the server, or this page itself where it is one file.

import { CUT_OFF } from './codings.js';

const own = globalThis.ERFGS;
export const alone = Boolean(own);

export const models = async () => (own ? own.models : (await fetch('api/models')).json());

const kept = new Map();
export function text(path) {
  if (own) return Promise.resolve(own.texts[path]);
  if (!kept.has(path)) {
    kept.set(path, fetch(`file/${path}`).then((response) => {
      if (!response.ok) throw new Error(`${path}: ${response.status}`);
      return response.text();
    }));
  }
  return kept.get(path);
}

// The bytes of a scene as they come.
export async function* scene(model) {
  const stream = own ? unpacked(model) : await fetched(`api/scene/${model}`);
  const reader = stream.getReader();
  for (let next = await reader.read(); !next.done; next = await reader.read()) yield next.value;
}

export const bytes = async (url) => new Response(await fetched(url)).arrayBuffer();

async function fetched(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`The server says: ${await response.text()}`);
  return response.body;
}

// How often a page of one file looks whether more of it is there.
const LOOK_MS = 20;

// A page of one file holds a scene in pieces, each of which can be used before the next has come.
function unpacked(model) {
  let index = 0;
  const packed = new ReadableStream({
    async pull(controller) {
      const piece = await whole(`scene${model}.${index}`);
      if (!piece) throw new Error(CUT_OFF);
      controller.enqueue(Uint8Array.from(atob(piece.textContent.trim()), (c) => c.charCodeAt(0)));
      index += 1;
      if (index === own.pieces[model]) controller.close();
    },
  });
  return packed.pipeThrough(new DecompressionStream('gzip'));
}

// An element of this page, once the browser has read it to its end; nothing if the page ends without it.
async function whole(id) {
  for (;;) {
    const loaded = document.readyState !== 'loading';
    const element = document.getElementById(id);
    if (loaded || element?.nextSibling) return element;
    await new Promise((done) => { setTimeout(done, LOOK_MS); });
  }
}
