"""Events of one camera as voxel grids, one for each exposure of another: what networks that deblur frames are trained on.

usage: voxels.py TAKE.mcap EVENT_CAMERA FRAME_CAMERA OUT.npz [BINS]

OUT.npz holds images (n, height, width, 3), exposures (n, 2; microseconds) and voxels (n, bins, height, width): the sum of polarities,
+1 for a rise and -1 for a fall.
"""

import sys

import numpy as np

import erfgs


def main(path: str, event_camera: str, frame_camera: str, out: str, bins: str = "5") -> None:
    images, exposures, voxels = [], [], []
    with erfgs.open(path) as session:
        stream = session[event_camera]
        for frame in session[frame_camera].frames():
            if frame.exposure is None:
                raise SystemExit(f"nothing tells how long {frame_camera} exposed its frames")
            start, end = frame.exposure
            events = stream.events(start, end)
            grid = np.zeros((int(bins), stream.height, stream.width), np.int32)
            bin = (events["t"] - start) * int(bins) // max(end - start, 1)
            np.add.at(grid, (bin, events["y"], events["x"]), 2 * events["p"].astype(np.int32) - 1)
            images.append(frame.image)
            exposures.append(frame.exposure)
            voxels.append(grid)
    if not images:
        raise SystemExit(f"{frame_camera} has no frames whose times are known")
    np.savez_compressed(out, images=np.stack(images), exposures=np.array(exposures), voxels=np.stack(voxels))
    print(f"{len(images)} frames of {frame_camera}, {sum(int(np.abs(grid).sum()) for grid in voxels)} events of {event_camera}")


if __name__ == "__main__":
    main(*sys.argv[1:])
