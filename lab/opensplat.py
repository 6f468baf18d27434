#!/usr/bin/env python3
"""Held-out quality against processor time: this trainer and OpenSplat's CPU backend, on one static scene and the same points.

usage: lab/opensplat.py OPENSPLAT DATASET [--out FOLDER] [--core N] [--minutes M] [--peer-minutes M]

OPENSPLAT is the peer's program, which is built by hand (https://github.com/pierotofy/OpenSplat); nothing is fetched. DATASET has
one instant and initial points:

  erfgs dataset import panoptic FOLDER --frames 60..60 --scale 0.5 --out one
  erfgs dataset points one --method colmap+sweep --max-points 25000

Before that:

  cargo build --release -p erfgs -p erfgs-lab --features erfgs-lab/studies --bin erfgs --bin splat_quality

The peer reads the training cameras of `erfgs export --to nerfstudio`, and is run twice: as it comes (images grow from a quarter of
their size), and with whole images from the beginning. What it saves is rendered by `splat_quality`, once as its own code renders and
once with what lies before the lens of a held-out camera left out, as this trainer's own figures have it. All run on one core.
Processor time is what the kernel says of the process, reading and saving included for the peer.
"""

import argparse
import csv
import json
import os
import pathlib
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
TICKS = os.sysconf("SC_CLK_TCK")
LEVELS_DB = 0.5


def cpu_seconds(pid):
    """User and system time of a process so far, all its threads."""
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def training_cameras(folder):
    """Takes the held-out images out of an exported scene, as the peer trains on all that it is told of."""
    path = folder / "transforms.json"
    scene = json.loads(path.read_text())
    held_out = set(scene.pop("test_filenames", [])) | set(scene.pop("val_filenames", []))
    scene["frames"] = [frame for frame in scene["frames"] if frame["file_path"] not in held_out]
    path.write_text(json.dumps(scene))
    return len(scene["frames"])


def train_peer(program, scene, folder, core, minutes, options):
    """Processor seconds at each file that it saved."""
    folder.mkdir(parents=True)
    command = ["taskset", "-c", str(core), program, str(scene), "--cpu", "--keep-crs", "-n", "1000000"]
    command += ["--save-every", "100", "-o", str(folder / "splat.ply"), *options]
    saved = {}
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with open(folder / "log", "w") as log:
        child = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, env=environment)
        try:
            while child.poll() is None and cpu_seconds(child.pid) < 60 * minutes:
                for path in folder.glob("splat_*.ply"):
                    saved.setdefault(path, cpu_seconds(child.pid))
                time.sleep(0.2)
        finally:
            child.kill()
    if child.wait() > 0 or len(saved) < 2:
        sys.exit(f"opensplat.py: {program} ended early; see {folder / 'log'}")
    # The last one may not be whole.
    saved.pop(max(saved, key=saved.get))
    return dict(sorted(saved.items(), key=lambda item: item[1]))


def qualities(dataset, paths):
    """Gaussians, and PSNR of training frames, of held-out frames, and of these with the near plane of held-out cameras."""
    output = subprocess.run([ROOT / "target/release/splat_quality", dataset, *paths], check=True, stdout=subprocess.PIPE, text=True)
    rows = [line.rsplit(" ", 4) for line in output.stdout.splitlines()]
    return [(int(count), *map(float, figures)) for _, count, *figures in rows]


def reached(curve, level):
    """Processor seconds until a curve of (seconds, PSNR) first has this level."""
    return next((seconds for seconds, psnr in curve if psnr >= level), None)


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("opensplat")
    arguments.add_argument("dataset", type=pathlib.Path)
    arguments.add_argument("--out", type=pathlib.Path, default=pathlib.Path("opensplat"))
    arguments.add_argument("--core", type=int, default=0)
    arguments.add_argument("--minutes", type=float, default=2.0, help="of this trainer [default: 2]")
    arguments.add_argument("--peer-minutes", type=float, default=20.0, help="of each of the peer's runs [default: 20]")
    given = arguments.parse_args()
    if given.out.exists():
        sys.exit(f"opensplat.py: '{given.out}' is there already; name another folder with --out")
    erfgs = str(ROOT / "target/release/erfgs")
    scene = given.out / "scene"
    given.out.mkdir(parents=True)
    subprocess.run([erfgs, "export", given.dataset, "--to", "nerfstudio", "--out", scene, "-q"], check=True)
    print(f"{training_cameras(scene)} training cameras")

    curves = {}
    run = given.out / "erfgs"
    command = ["taskset", "-c", str(given.core), erfgs, "train", given.dataset, "--method", "4dgs", "--out", run, "-q"]
    subprocess.run([*command, "--iterations", "100000+0", "--cpu-minutes", str(given.minutes), "--seed", "1"], check=True)
    with open(run / "curve.csv") as file:
        looks = [row for row in csv.DictReader(file) if row["psnr"]]
    curves["erfgs"] = [(float(row["cpu_seconds"]), float(row["psnr"])) for row in looks]
    last = looks[-1]
    print(f"erfgs: {last['iteration']} iterations, {1e3 * curves['erfgs'][-1][0] / int(last['iteration']):.0f} ms each, {last['gaussians']} Gaussians")

    for name, options in [("as it comes", []), ("whole images", ["--num-downscales", "0"])]:
        folder = given.out / name.replace(" ", "-")
        saved = train_peer(given.opensplat, scene, folder, given.core, given.peer_minutes, options)
        found = qualities(given.dataset, list(saved))
        for kind, index in [("its own near plane", 2), ("ours", 3)]:
            curves[f"OpenSplat, {name}, {kind}"] = [(seconds, row[index]) for seconds, row in zip(saved.values(), found)]
        steps, times = [int(path.stem.rsplit("_", 1)[1]) for path in saved], list(saved.values())
        each = 1e3 * (times[-1] - times[0]) / max(steps[-1] - steps[0], 1)
        print(f"OpenSplat, {name}: {steps[-1]} iterations, {each:.0f} ms each, {found[-1][0]} Gaussians, {found[-1][1]:.2f} dB of training frames")
    (given.out / "curves.json").write_text(json.dumps(curves, indent=1))

    print("\nprocessor seconds until a PSNR of held-out frames, dB, is reached:")
    best = max(psnr for curve in curves.values() for _, psnr in curve)
    levels = [LEVELS_DB * step for step in range(int(15 / LEVELS_DB), int(best / LEVELS_DB) + 1)]
    for name, curve in curves.items():
        seconds = [reached(curve, level) for level in levels]
        print(f"{name}: best {max(psnr for _, psnr in curve):.2f}")
        print("  " + ", ".join(f"{level:g}: {at:.1f}" for level, at in zip(levels, seconds) if at is not None))


if __name__ == "__main__":
    main()
