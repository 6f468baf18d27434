"""The examples run on recordings, and the reference is what the module says of itself."""

import subprocess
import sys

import numpy as np
from conftest import ROOT

EXAMPLES = ROOT / "python/examples"


def run(name, *arguments):
    command = [sys.executable, "-W", "error", EXAMPLES / name, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_slices(take):
    said = run("slices.py", take, 100)
    assert said[0].startswith("event0: hardware-triggered, 95 of 100 samples within 0.")
    assert sum(" ms: events event0 " in line for line in said) == 22 and any("rgb3 " in line for line in said)


def test_voxels(take, tmp_path):
    out = tmp_path / "voxels.npz"
    (said,) = run("voxels.py", take, "event0", "rgb0", out, 3)
    found = np.load(out)
    count = len(found["images"])
    assert said.startswith(f"{count} frames of rgb0") and count > 30
    assert found["voxels"].shape == (count, 3, 720, 1280) and found["images"].shape == (count, 120, 160, 3)
    assert np.abs(found["voxels"]).sum() > 10_000 and np.all(np.diff(found["exposures"], axis=1) > 0)


def test_dataset(dataset):
    said = run("dataset.py", dataset)
    assert "4 cameras, 0.10 s" in said[0]
    assert sum("rises" in line for line in said) == 1 and sum("levels change" in line for line in said) >= 2


def test_scene(trained, tmp_path):
    film, folder = trained
    out = tmp_path / "gaussians.npz"
    said = run("scene.py", folder, film, out)
    found = np.load(out)
    assert said[0].startswith(f"{len(found['means'])} Gaussians") and len(found["means"]) == len(found["opacities"]) > 1000
    assert sum(line.startswith("test00 at ") and float(line.split()[-2]) > 10 for line in said) == len(said) - 1 > 3


def test_simulate():
    said = run("simulate.py")
    assert int(said[0].split()[0]) > 10_000 and len(said) == 6
    columns = [int(line.split()[-1]) for line in said[1:]]
    assert columns == sorted(columns) and columns[-1] - columns[0] > 90, "the disc crosses 115 columns between the middles"


def test_train(recordings):
    said = run("train.py", recordings / "davis346.aedat4", "davis346", 600)
    shares = [float(line.split()[-2]) for line in said[1:]]
    assert said[0].startswith("58 pairs of frames") and 0.4 < shares[0] < shares[1] - 0.1, said


def test_all_examples_are_here():
    names = {"slices.py", "voxels.py", "dataset.py", "scene.py", "simulate.py", "train.py"}
    assert {path.name for path in EXAMPLES.iterdir()} == names


def test_the_reference_is_that_of_this_module(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "python")
    import reference

    page = (ROOT / "docs/reference/python.md").read_text()
    assert page == reference.whole(), "write it anew: python python/reference.py > docs/reference/python.md"
