"""A small network that learns from a take what events are worth: how the light at a pixel changes from one frame to the next, by the
events around it. For sensors that see both on the same pixels (DAVIS); NumPy is all that it needs.

usage: train.py RECORDING STREAM [STEPS]

Frames of the last quarter are held out. What is printed are shares of the change of light (its variance) that are explained there: by one
threshold for rises and one for falls, and by the network.
"""

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import erfgs

Numbers = NDArray[np.floating[Any]]
BINS, REACH, HIDDEN, BATCH = 4, 1, 32, 1024


def grids(events: NDArray[np.void], start: int, end: int, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Falls and rises of each pixel in BINS parts of a time: (2 * BINS, height, width)."""
    counts = np.zeros((2 * BINS, *shape), np.float32)
    bin = (events["t"] - start) * BINS // max(end - start, 1)
    np.add.at(counts, (2 * bin + events["p"], events["y"], events["x"]), 1)
    return counts


def examples(stream: erfgs.Stream, random: np.random.Generator) -> Iterator[tuple[Numbers, Numbers]]:
    """For each pair of frames: counts around pixels that saw something, and the change of the logarithm of the light."""
    side = 2 * REACH + 1
    shape = (stream.height, stream.width, -1)
    frames = [(frame.t, np.log1p(frame.image.reshape(shape).mean(axis=-1, dtype=np.float32))) for frame in stream.frames()]
    for (start, before), (end, after) in zip(frames, frames[1:]):
        counts = grids(stream.events(start, end), start, end, before.shape)
        windows = np.lib.stride_tricks.sliding_window_view(counts, (side, side), axis=(1, 2))
        change = (after - before)[REACH:-REACH, REACH:-REACH]
        busy = np.flatnonzero(windows.sum(axis=(0, 3, 4)).ravel())
        chosen = random.choice(busy, min(len(busy), 4000), replace=False)
        y, x = np.unravel_index(chosen, change.shape)
        yield windows[:, y, x].transpose(1, 0, 2, 3).reshape(len(chosen), -1), change[y, x]


class Network:
    """Two layers, and Adam."""

    def __init__(self, inputs: int, random: np.random.Generator) -> None:
        shapes: list[tuple[int, ...]] = [(inputs, HIDDEN), (HIDDEN,), (HIDDEN, 1), (1,)]
        self.weights = [random.normal(0, (2 / shape[0]) ** 0.5, shape) if len(shape) > 1 else np.zeros(shape) for shape in shapes]
        self.moments = [(np.zeros(shape), np.zeros(shape)) for shape in shapes]
        self.steps = 0

    def __call__(self, x: Numbers) -> Numbers:
        first, bias, second, offset = self.weights
        self.hidden: Numbers = np.maximum(x @ first + bias, 0)
        return np.asarray((self.hidden @ second + offset)[:, 0])

    def learn(self, x: Numbers, y: Numbers, rate: float = 3e-3) -> None:
        error = (self(x) - y)[:, None] / len(y)
        back = (error @ self.weights[2].T) * (self.hidden > 0)
        gradients = [x.T @ back, back.sum(0), self.hidden.T @ error, error.sum(0)]
        self.steps += 1
        for weight, gradient, (mean, square) in zip(self.weights, gradients, self.moments):
            mean += 0.1 * (gradient - mean)
            square += 0.001 * (gradient**2 - square)
            scaled = mean / (1 - 0.9**self.steps), square / (1 - 0.999**self.steps)
            weight -= rate * scaled[0] / (np.sqrt(scaled[1]) + 1e-8)


def own(x: Numbers) -> Numbers:
    """Falls and rises of the pixels themselves."""
    return np.asarray(x.reshape(len(x), BINS, 2, -1)[..., (2 * REACH + 1) ** 2 // 2].sum(axis=1))


def explained(found: Numbers, truth: Numbers) -> float:
    return 1 - float(np.mean((found - truth) ** 2) / np.mean((truth - truth.mean()) ** 2))


def main(path: str, name: str, steps: str = "1500") -> None:
    random = np.random.default_rng(1)
    with erfgs.open(path) as recording:
        pairs = list(examples(recording[name], random))
    if len(pairs) < 8:
        raise SystemExit(f"{name} has {len(pairs) + 1} frames; nine and more are needed")
    held_out = len(pairs) * 3 // 4
    x, y = (np.concatenate(part) for part in zip(*pairs[:held_out]))
    x_test, y_test = (np.concatenate(part) for part in zip(*pairs[held_out:]))
    thresholds = np.linalg.lstsq(own(x), y, rcond=None)[0]
    network = Network(x.shape[1], random)
    for _ in range(int(steps)):
        batch = random.integers(0, len(x), BATCH)
        network.learn(x[batch], y[batch])
    print(f"{len(pairs)} pairs of frames, {len(x)} pixels to learn from, {len(x_test)} held out")
    print(f"one threshold each ({-thresholds[0]:.3f} down, {thresholds[1]:.3f} up): {explained(own(x_test) @ thresholds, y_test):.2f} explained")
    print(f"the network: {explained(network(x_test), y_test):.2f} explained")


if __name__ == "__main__":
    main(*sys.argv[1:])
