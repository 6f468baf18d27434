"""How well a reconstruction shows what held-out cameras saw, and its Gaussians in the middle of the recording, as gsplat takes them.

usage: scene.py RUN DATASET OUT.npz
"""

import sys

import numpy as np

import erfgs


def main(run: str, folder: str, out: str) -> None:
    scene, dataset = erfgs.Scene.open(run), erfgs.Dataset.load(folder)
    print(f"{scene.count} Gaussians, {scene.moving_count} of them move, drawn by {scene.adapter}")
    for name in scene.held_out:
        camera = dataset[name]
        for index, frame in enumerate(camera.frames):
            shown, taken = scene.render(name, frame.t).image / 255, camera.image(index) / 255
            print(f"{name} at {frame.t / 1000:.1f} ms: {-10 * np.log10(np.mean((shown - taken) ** 2)):.2f} dB")
    # gsplat.rasterization(means, quats, scales, opacities, colors, ...) takes the rows of these as they are.
    gaussians = scene.gaussians(sum(scene.span) // 2)
    np.savez(out, **gaussians._asdict())


if __name__ == "__main__":
    main(*sys.argv[1:])
