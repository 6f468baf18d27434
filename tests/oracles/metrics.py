"""SSIM and LPIPS by convolutions of JAX, on random pictures and random weights.

usage: metrics.py FOLDER

Writes into FOLDER: a.f32 and b.f32 (height x width x 3, little-endian), alex.safetensors and vgg16.safetensors, and
expected.json with the values that the program must find.
"""

import json
import pathlib
import struct
import sys

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

HEIGHT, WIDTH = 45, 70
ALEX = [("conv", 0, 64, 11, 4, 2), "look", ("pool", 3, 2), ("conv", 3, 192, 5, 1, 2), "look", ("pool", 3, 2),
        ("conv", 6, 384, 3, 1, 1), "look", ("conv", 8, 256, 3, 1, 1), "look", ("conv", 10, 256, 3, 1, 1), "look"]
VGG16 = []
for channels, indices in [(64, [0, 2]), (128, [5, 7]), (256, [10, 12, 14]), (512, [17, 19, 21]), (512, [24, 26, 28])]:
    VGG16 += [("pool", 2, 2)] if VGG16 else []
    VGG16 += [("conv", index, channels, 3, 1, 1) for index in indices] + ["look"]


def convolve(x, weight, bias, stride, padding):
    """NCHW cross-correlation, the layout that the published networks use."""
    y = jax.lax.conv_general_dilated(x, weight, (stride, stride), [(padding, padding)] * 2,
                                     dimension_numbers=("NCHW", "OIHW", "NCHW"))
    return y + bias


def pool(x, size, stride):
    return jax.lax.reduce_window(x, -jnp.inf, jax.lax.max, (1, 1, size, size), (1, 1, stride, stride), "VALID")


def random_weights(layers, rng):
    tensors, inputs, looks = {}, 3, 0
    for layer in layers:
        if layer == "look":
            tensors[f"lin{looks}.model.1.weight"] = rng.uniform(0, 1, (1, inputs, 1, 1))
            looks += 1
        elif layer[0] == "conv":
            _, index, outputs, size, _, _ = layer
            spread = np.sqrt(2 / (inputs * size * size))
            tensors[f"features.{index}.weight"] = rng.normal(0, spread, (outputs, inputs, size, size))
            tensors[f"features.{index}.bias"] = rng.normal(0, 0.1, outputs)
            inputs = outputs
    return {name: tensor.astype(np.float32) for name, tensor in tensors.items()}


def lpips(layers):
    """The distance of a pair, which is compiled once."""
    def unit(x):
        return x / (jnp.sqrt(jnp.sum(x**2, axis=1, keepdims=True)) + 1e-10)

    @jax.jit
    def distance(pair, tensors):
        tensors = {name: tensor.astype(jnp.float64) for name, tensor in tensors.items()}
        shift = jnp.array([-0.030, -0.088, -0.188])[:, None, None]
        scale = jnp.array([0.458, 0.448, 0.450])[:, None, None]
        pair, looks, total = (pair.transpose(0, 3, 1, 2) - shift) / scale, 0, 0.0
        for layer in layers:
            if layer == "look":
                a, b = unit(pair)
                difference = (a - b) ** 2
                total += jnp.mean(jnp.sum(tensors[f"lin{looks}.model.1.weight"][0] * difference, axis=0))
                looks += 1
            elif layer[0] == "pool":
                pair = pool(pair, *layer[1:])
            else:
                _, index, _, _, stride, padding = layer
                weight, bias = (tensors[f"features.{index}.{kind}"] for kind in ("weight", "bias"))
                pair = jnp.maximum(convolve(pair, weight, bias[:, None, None], stride, padding), 0)
        return total

    return distance


@jax.jit
def ssim(a, b):
    x = np.arange(11) - 5
    line = np.exp(-(x**2) / (2 * 1.5**2))
    line /= line.sum()
    window = jnp.asarray(np.tile(np.outer(line, line), (3, 1, 1, 1)))
    a, b = (jnp.asarray(image, jnp.float64).transpose(2, 0, 1)[None] for image in (a, b))

    def blur(x):
        return jax.lax.conv_general_dilated(x, window, (1, 1), [(5, 5), (5, 5)], feature_group_count=3,
                                            dimension_numbers=("NCHW", "OIHW", "NCHW"))

    ma, mb = blur(a), blur(b)
    va, vb, cov = blur(a * a) - ma**2, blur(b * b) - mb**2, blur(a * b) - ma * mb
    value = ((2 * ma * mb + 0.01**2) * (2 * cov + 0.03**2)) / ((ma**2 + mb**2 + 0.01**2) * (va + vb + 0.03**2))
    return value.mean()


def write_safetensors(path, tensors):
    header, offset = {}, 0
    for name, tensor in tensors.items():
        header[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": [offset, offset + tensor.nbytes]}
        offset += tensor.nbytes
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + b"".join(t.tobytes() for t in tensors.values()))


def main():
    folder = pathlib.Path(sys.argv[1])
    rng = np.random.default_rng(7)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] / 20
    a = np.stack([np.sin(3 * x + c) * np.cos(2 * y - c) for c in range(3)], -1) * 0.4 + 0.5
    a = np.clip(a + rng.normal(0, 0.05, a.shape), 0, 1).astype(np.float32)
    b = np.clip(np.roll(a, 1, axis=1) + rng.normal(0, 0.03, a.shape), 0, 1).astype(np.float32)
    (folder / "a.f32").write_bytes(a.tobytes())
    (folder / "b.f32").write_bytes(b.tobytes())
    expected = {"width": WIDTH, "height": HEIGHT, "ssim": float(ssim(a, b))}
    for name, layers in [("alex", ALEX), ("vgg16", VGG16)]:
        tensors = random_weights(layers, rng)
        write_safetensors(folder / f"{name}.safetensors", tensors)
        pair, distance = np.stack([a, b]).astype(np.float64), lpips(layers)
        expected[name] = {"zero_to_one": float(distance(pair, tensors)),
                          "minus_one_to_one": float(distance(2 * pair - 1, tensors))}
    (folder / "expected.json").write_text(json.dumps(expected))


main()
