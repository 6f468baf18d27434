// Where scenes and texts come from: the server, or this page itself where it is one file.

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

// The bytes of a scene, telling how many of `total` are there.
export async function scene(model, total, told) {
  const stream = own ? unpacked(document.getElementById(`scene${model}`).textContent) : await fetched(`api/scene/${model}`);
  const reader = stream.getReader();
  const bytes = new Uint8Array(total);
  let at = 0;
  for (;;) {
    const { done, value } = await reader.read();
    if (done) break;
    if (at + value.length > total) throw new Error('The scene is longer than it was said to be.');
    bytes.set(value, at);
    at += value.length;
    told(at / total);
  }
  if (at < total) throw new Error('The scene is cut off: load the page again.');
  return bytes.buffer;
}

export const bytes = async (url) => new Response(await fetched(url)).arrayBuffer();

async function fetched(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`The server says: ${await response.text()}`);
  return response.body;
}

function unpacked(base64) {
  const packed = Uint8Array.from(atob(base64.trim()), (c) => c.charCodeAt(0));
  return new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
}
