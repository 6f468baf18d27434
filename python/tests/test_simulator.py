"""Simulated event cameras: against the program, and against what a pixel must do."""

import subprocess
import threading

import numpy as np
import pytest

import erfgs


@pytest.fixture(scope="module")
def video():
    """A bright disc that crosses a grey ramp, 20 frames."""
    y, x = np.mgrid[:48, :64]
    disc = [(x - 3 * at) ** 2 + (y - 24) ** 2 < 80 for at in range(20)]
    return np.stack([np.where(inside, 220, 40 + x + y) for inside in disc]).astype(np.uint8)


@pytest.mark.parametrize(
    ("preset", "parameters", "options"),
    [
        ("noiseless", {}, []),
        ("noisy", {"seed": 7}, ["--simulator", "noisy", "--seed", "7"]),
        (
            "clean",
            {"mode": "enhanced", "cutoff_hz": 200, "hot_fraction": 0.01, "hot_hz": np.float32(50), "threshold_on": 0.25},
            ["--simulator", "clean", "--mode", "enhanced", "--cutoff-hz", "200", "--hot-fraction", "0.01"]
            + ["--hot-hz", "50", "--threshold-on", "0.25"],
        ),
    ],
)
def test_events_are_those_of_the_program(video, programs, tmp_path, preset, parameters, options):
    np.savez(tmp_path / "luma.npz", luma=video)
    out = tmp_path / "events.npz"
    command = [programs / "erfgs", "simulate", tmp_path / "luma.npz", "--fps", "30", "--out", out, "-q", *options]
    subprocess.run(command, check=True, capture_output=True)
    stored = np.load(out)
    events = erfgs.simulate(iter(video), 30, preset, **parameters)
    assert events.dtype == erfgs.EVENT_DTYPE and len(events) > 1000
    for field in "txyp":
        assert np.array_equal(events[field], stored[field]), field


def test_a_pixel_has_an_event_for_each_threshold_that_its_logarithm_crosses():
    frames = np.full((2, 3, 4), 50, np.float32)
    frames[1, 2, 1] = 50 * np.exp(0.65)
    frames[1, 0, 3] = 50 * np.exp(-0.45)
    events = erfgs.simulate(frames, 100, threshold_on=0.2, threshold_off=0.2)
    places = [(e["x"], e["y"], e["p"]) for e in events]
    assert places.count((1, 2, 1)) == 3 and places.count((3, 0, 0)) == 2 and len(places) == 5
    assert 0 < events["t"].min() and events["t"].max() <= 10_000 and (np.diff(events["t"]) >= 0).all()


def test_colours_count_by_their_luma_and_steps_are_those_of_the_whole(video):
    whole = erfgs.simulate(video, 40)
    grey = np.repeat(video[..., None], 3, axis=3)
    in_colour = erfgs.simulate(grey, 40)
    assert abs(len(in_colour) - len(whole)) <= 0.01 * len(whole)
    sensor = erfgs.Simulator(64, 48)
    steps = [sensor.step(frame, 25_000 * at) for at, frame in enumerate(video)]
    assert len(steps[0]) == 0 and np.concatenate(steps).tolist() == whole.tolist()
    assert sensor.parameters["threshold_on"] == 0.2 and sensor.parameters["mode"] == "parity" and "64 x 48" in repr(sensor)
    assert len(erfgs.simulate([], 30)) == 0


def test_cameras_of_other_names_and_other_seeds_have_other_noise(video):
    def noisy(**more):
        return erfgs.simulate(video, 30, "noisy", **more).tobytes()

    first = noisy(camera="left", seed=1)
    assert first == noisy(camera="left", seed=1)
    assert len({first, noisy(camera="right", seed=1), noisy(camera="left", seed=2), noisy(seed=1)}) == 4


def test_sensors_work_in_threads(video):
    found = {}

    def run(name):
        found[name] = erfgs.simulate(video, 30, "noisy", camera=name)

    threads = [threading.Thread(target=run, args=(f"camera{at}",)) for at in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(events, erfgs.simulate(video, 30, "noisy", camera=name)) for name, events in found.items())


def test_what_cannot_be_simulated_is_refused_with_what_can(video):
    for error, message, call in (
        (ValueError, "there is no preset 'loud'; there are noiseless, clean, noisy", lambda: erfgs.Simulator(4, 3, "loud")),
        (TypeError, "no parameter 'treshold'; there are .*threshold_on", lambda: erfgs.Simulator(4, 3, treshold=0.1)),
        (ValueError, "the event simulator's parameters", lambda: erfgs.Simulator(4, 3, sigma=float("nan"))),
        (ValueError, "the event simulator's parameters", lambda: erfgs.Simulator(4, 3, mode="best")),
        (erfgs.Error, "threshold_on is 0; choose a value from", lambda: erfgs.Simulator(4, 3, threshold_on=0)),
        (erfgs.Error, "has no hot_hz", lambda: erfgs.Simulator(4, 3, hot_hz=5)),
        (erfgs.Error, "0 x 3 pixels", lambda: erfgs.Simulator(0, 3)),
        (ValueError, "a rate from 0.001", lambda: erfgs.simulate(video, 0)),
        (ValueError, r"the first one has \(64,\)", lambda: erfgs.simulate(video[0], 30)),
        (ValueError, r"frames have shape \[3, 4\]", lambda: erfgs.Simulator(4, 3).step(video[0], 0)),
        (ValueError, "NaN is no time", lambda: erfgs.Simulator(4, 3).step(np.zeros((3, 4), np.uint8), float("nan"))),
        (erfgs.Error, "luma -1 at column 1, row 0", lambda: erfgs.simulate(np.array([[[0, -1]]], np.float32), 30)),
        (TypeError, "uint8 or float32", lambda: erfgs.Simulator(4, 3).step(np.zeros((3, 4), np.int64), 0)),
    ):
        with pytest.raises(error, match=message):
            call()
    sensor = erfgs.Simulator(64, 48)
    sensor.step(video[0], 1000)
    with pytest.raises(erfgs.Error, match="sort the frames by time"):
        sensor.step(video[1], 1000)
    assert len(sensor.step(video[5], 2000)) > 100
