"""Where tests find recordings: real ones that scripts/setup.sh --oracles fetches, and emulated ones, which are recorded here."""

import os
import pathlib
import subprocess

import numpy as np
import pytest

import erfgs

ROOT = pathlib.Path(__file__).resolve().parents[2]


def named(variable, default, remedy):
    path = pathlib.Path(os.environ.get(variable, default))
    if not path.is_dir():
        pytest.exit(f"{path} is missing: {remedy}", returncode=2)
    return path


@pytest.fixture(scope="session")
def recordings():
    return named("ERFGS_RECORDINGS", ROOT / "target/recordings", "`scripts/setup.sh --oracles` fetches it")


@pytest.fixture(scope="session")
def programs():
    return named("ERFGS_PROGRAMS", ROOT / "target/debug", "`scripts/python.sh` builds it, or name another in ERFGS_PROGRAMS")


@pytest.fixture(scope="session")
def take(programs, tmp_path_factory):
    """A small rig of two event cameras, five frame cameras and a trigger board, emulated."""
    path = tmp_path_factory.mktemp("take") / "take.mcap"
    subprocess.run([programs / "erfgs-emulated-rig", "performance", "--small", path], check=True, capture_output=True)
    return path


@pytest.fixture(scope="session")
def dataset(programs, tmp_path_factory):
    """A film of the stage: two RGB cameras, an event camera and a held-out one, over 100 ms."""
    path = tmp_path_factory.mktemp("dataset") / "ds"
    size = ["--size", "64x48", "--rgb", "2", "--event", "1", "--test", "1", "--duration-ms", "100", "--rgb-fps", "20"]
    subprocess.run([programs / "erfgs-stage", "film", "--out", path, *size], check=True, capture_output=True)
    return path


@pytest.fixture(scope="session")
def trained(programs, tmp_path_factory):
    """A film of the stage by four RGB cameras, an event camera and a held-out one, and what a short training makes of it."""
    folder = tmp_path_factory.mktemp("trained")
    film, run = folder / "film", folder / "run"
    size = ["--size", "64x48", "--rgb", "4", "--event", "1", "--test", "1", "--duration-ms", "200", "--rgb-fps", "20"]
    for command in (
        ["erfgs-stage", "film", "--out", film, *size],
        ["erfgs", "dataset", "points", film, "--method", "random", "--random-points", "1000", "-q"],
        ["erfgs", "train", film, "--out", run, "--iterations", "60+120", "--motion", "free-time", "-q"],
    ):
        subprocess.run([programs / command[0], *command[1:]], check=True, capture_output=True)
    return film, run


@pytest.fixture
def text_file(tmp_path):
    """A file of events at known places and times: its path and the events."""
    count = 5000
    n = np.arange(count)
    events = np.zeros(count, erfgs.EVENT_DTYPE)
    events["t"], events["x"], events["y"], events["p"] = 7_000_000 + 211 * n, n % 61, n % 47, n % 2
    lines = (f"{e['t']},{e['x']},{e['y']},{e['p']}" for e in events)
    path = tmp_path / "known.csv"
    path.write_text("t,x,y,on\n" + "\n".join(lines) + "\n")
    return path, events
