// Files that the page hands to its user.

export function save(name, blob) {
  const anchor = Object.assign(document.createElement('a'), { href: URL.createObjectURL(blob), download: name });
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(anchor.href), 10_000);
}

// What is seen, as a PNG: the second picture right of the share `split`.
export async function savePicture(name, painters, view, t01, how, split) {
  const picture = Object.assign(document.createElement('canvas'), { width: view.width, height: view.height });
  const paint = picture.getContext('2d');
  for (const [k, painter] of painters.entries()) {
    const pixels = await painter.pixels(view, t01, how);
    for (let i = 3; i < pixels.length; i += 4) pixels[i] = 255;
    const left = k === 0 ? 0 : Math.round(view.width * split);
    paint.putImageData(new ImageData(new Uint8ClampedArray(pixels.buffer), view.width), 0, 0, left, 0, view.width - left, view.height);
  }
  save(name, await new Promise((done) => { picture.toBlob(done); }));
}
