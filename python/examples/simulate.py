"""What an event camera would see of a video: a disc that crosses a textured background, and where its events are.

    python simulate.py
"""

from __future__ import annotations

from typing import Iterator

import numpy as np
from numpy.typing import NDArray

import erfgs

FPS, WIDTH, HEIGHT = 240, 160, 90


def video() -> Iterator[NDArray[np.uint8]]:
    """Frames as a decoder of videos gives them: one by one, red, green, blue."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    background = 90 + 40 * np.sin(0.3 * x) * np.cos(0.2 * y)
    for index in range(FPS // 2):
        inside = (x - 10 - 1.2 * index) ** 2 + (y - 45) ** 2 < 150
        grey = np.where(inside, 210, background)
        yield np.repeat(grey[..., None], 3, axis=2).astype(np.uint8)


if __name__ == "__main__":
    # Thresholds that differ from pixel to pixel, and the noise of a sensor in the dark.
    events = erfgs.simulate(video(), FPS, "noisy", mode="enhanced", cutoff_hz=300, seed=1)
    seconds = int(events["t"].max()) / 1e6
    print(f"{len(events)} events in {seconds:.2f} s, {np.mean(events['p']):.0%} of them brighter")
    for start in range(0, 500_000, 100_000):
        part = events[(events["t"] >= start) & (events["t"] < start + 100_000)]
        columns = np.bincount(part["x"], minlength=WIDTH)
        print(f"{start // 1000:>4} ms: {len(part):>6} events, most of them around column {int(np.convolve(columns, np.ones(15), 'same').argmax())}")
