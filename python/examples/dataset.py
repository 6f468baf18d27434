"""The cameras of a dataset: where they stand, how they see one another, and what happened between two frames.

usage: dataset.py FOLDER
"""

import sys

import numpy as np

import erfgs


def main(path: str) -> None:
    dataset = erfgs.Dataset.load(path)
    print(f"{dataset.name}: {len(dataset)} cameras, {(dataset.span[1] - dataset.span[0]) / 1e6:.2f} s")
    centres = np.array([camera.camera.centre for camera in dataset.cameras.values()])
    for name, camera in dataset.cameras.items():
        size = np.array([camera.camera.width, camera.camera.height])
        pixels = camera.camera.project(centres)
        seen = np.all((pixels >= 0) & (pixels < size), axis=1)
        print(f"{name} ({camera.split}, {camera.modality}) at {centres[list(dataset).index(name)].round(2)} sees {seen.sum()} others")
        if camera.modality != "rgb":
            counts = camera.counts(*dataset.span)
            print(f"  {counts[0].sum()} falls and {counts[1].sum()} rises, at most {counts.sum(0).max()} of one pixel")
        for index, (a, b) in enumerate(zip(camera.frames, camera.frames[1:])):
            change = np.abs(camera.image(index + 1).astype(int) - camera.image(index)).mean()
            print(f"  {a.t / 1000:.1f} to {b.t / 1000:.1f} ms: levels change by {change:.2f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
