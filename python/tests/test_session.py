"""A session of an emulated rig: all cameras on one clock."""

import multiprocessing
import pickle
import threading
import warnings

import numpy as np
import pytest

import erfgs


@pytest.fixture(scope="module")
def session(take):
    return erfgs.open(take)


def test_streams_say_what_they_are(session, take):
    assert list(session) == list(session.streams) and len(session) == 8 and session.path == take
    kinds = {id: stream.kind for id, stream in session.streams.items()}
    assert kinds == {
        "event0": "events",
        "davis": "events",
        "board": "trigger",
        **{f"rgb{n}": "frames" for n in range(4)},
        "free0": "frames",
    }
    rgb = session["rgb0"]
    assert (rgb.width, rgb.height, rgb.encoding) == (160, 120, "mjpeg")
    assert rgb.settings["triggered"] is True and session["event0"].settings["biases"]
    assert session.faults == [] and session.epoch_ns > 0 and 2_000_000 < session.duration < 3_000_000
    assert "event0" in session and "nobody" not in session and "rgb0" in repr(session)


def test_clocks_come_with_residuals_and_map_ticks(session):
    clock = session.clock("event0")
    assert clock.tier == "hardware-triggered" and clock.stream == "event0"
    assert 0 < clock.p50 <= clock.p95 <= clock.max < 2, "the board's ticks and the camera's: within 2 µs"
    (part,) = clock.parts
    assert part.is_dated and abs(part.rate_ppm) < 200 and part.residuals == (clock.p50, clock.p95, clock.max)
    stream = session["event0"]
    device, events = stream.events(clock="device"), stream.events()
    assert np.array_equal(part.to_session(device["t"]), events["t"])
    assert session.clock("free0").tier == "free-running" and session.clock("free0").parts == []
    assert session.clock("rgb0").undated_frames == 0


def test_frames_are_triggered_together_and_exposed_as_set(session):
    frames = {id: list(session[id].frames()) for id in ["rgb0", "rgb1"]}
    assert len(frames["rgb0"]) == session["rgb0"].packets
    exposure_us = session["rgb0"].settings["exposure_us"]
    for left, right in zip(*frames.values()):
        assert abs(left.t - right.t) <= 1
        assert left.image.shape == (120, 160, 3) and left.image.dtype == np.uint8 and left.image.std() > 5
        start, end = left.exposure
        assert abs((end - start) - exposure_us) <= 1 and abs((start + end) // 2 - left.t) <= 1
    assert np.all(np.diff([frame.t for frame in frames["rgb0"]]) > 0)
    some = frames["rgb0"][5:9]
    again = list(session["rgb0"].frames(some[0].t, some[-1].t + 1))
    assert [frame.sequence for frame in again] == [frame.sequence for frame in some]
    assert all(np.array_equal(a.image, b.image) for a, b in zip(again, some))
    deep = next(session["rgb0"].frames(some[0].t, depth=16))
    assert deep.image.dtype == np.uint16 and np.array_equal(deep.image, 257 * some[0].image.astype(np.uint16))


def test_slices_hold_all_of_every_camera_once(session):
    slices = list(session.slices(40_000))
    assert [s.start for s in slices] == list(range(0, 40_000 * len(slices), 40_000))
    assert all(a.end == b.start for a, b in zip(slices, slices[1:])) and slices[-1].end >= session.duration
    for id in ["event0", "davis"]:
        whole = session[id].events(0)
        assert len(whole) > 10_000
        assert np.array_equal(np.concatenate([s.events[id] for s in slices]), whole)
        assert all(s.start <= t < s.end for s in slices if len(s.events[id]) for t in s.events[id]["t"][[0, -1]])
    for id in ["rgb0", "free0"]:
        expected = [(frame.sequence, frame.t) for frame in session[id].frames(0)]
        assert [(f.sequence, f.t) for s in slices for f in s.frames[id]] == expected
        assert all(s.start <= f.t < s.end for s in slices for f in s.frames[id])
    assert set(slices[0].events) == {"event0", "davis"} and "rgb0" not in slices[0].events
    some = session.slice(1_000_000, 1_040_000, ["event0", "rgb1"])
    (same,) = [s for s in slices if s.start == 1_000_000]
    assert list(some.frames) == ["rgb1"] and np.array_equal(some.events["event0"], same.events["event0"])


def test_everything_pickles_and_other_processes_read(session, take):
    again, stream = pickle.loads(pickle.dumps((session, session["event0"])))
    assert again.duration == session.duration and len(stream.events(0, 10**6)) == len(session["event0"].events(0, 10**6))
    frame = next(session["rgb0"].frames())
    copy = pickle.loads(pickle.dumps(frame))
    assert isinstance(copy, erfgs.Frame) and np.array_equal(copy.image, frame.image)
    dataset = erfgs.SliceDataset(take, 100_000, ["event0", "rgb0"], transform=summary)
    here = [dataset[n] for n in range(len(dataset))]
    assert sum(events for events, _ in here) == len(session["event0"].events(0))
    for method in ["fork", "spawn"]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            with multiprocessing.get_context(method).Pool(2) as pool:
                assert pool.map(dataset.__getitem__, range(len(dataset))) == here, method


def summary(part):
    return len(part.events["event0"]), [frame.t for frame in part.frames["rgb0"]]


def test_a_dataset_is_as_long_as_its_span(take):
    dataset = erfgs.SliceDataset(take, 30_000, start=1_000_000, end=1_100_000)
    assert len(dataset) == 4 and dataset[-1].end == 1_100_000 and dataset[-1].start == 1_090_000
    assert isinstance(dataset[0], erfgs.Slice)
    with pytest.raises(IndexError, match="4 slices"):
        dataset[4]
    with pytest.raises(ValueError, match="above 0"):
        erfgs.SliceDataset(take, 0)


def test_threads_read_at_once_and_the_lock_is_free_meanwhile(session):
    expected = session["event0"].events(0, 500_000)
    found, turns, done = {}, 0, threading.Event()

    def read(n):
        found[n] = [session["event0"].events(0, 500_000), sum(len(s.frames["rgb0"]) for s in session.slices(50_000))]

    threads = [threading.Thread(target=read, args=(n,)) for n in range(3)]
    watcher = threading.Thread(target=lambda: [t.join() for t in threads] and done.set())
    for thread in [*threads, watcher]:
        thread.start()
    while not done.wait(0.001):
        turns += 1
    assert all(np.array_equal(events, expected) and frames > 0 for events, frames in found.values()) and len(found) == 3
    assert turns > 5, "Python went on while the library read"


def test_what_is_damaged_is_told_and_the_rest_read(take, tmp_path):
    data = bytearray(take.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 4096] = bytes(4096)
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(data)
    with erfgs.open(broken) as session, warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        left = len(session["event0"].events())
    assert {one.category for one in told} == {erfgs.DamageWarning}
    assert any("broken.mcap" in str(one.message) for one in told)
    assert any("packets of the" in str(one.message) for one in told)
    with erfgs.open(take) as session:
        assert 0 < left < len(session["event0"].events())
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(take.read_bytes()[:2_000_000])
    with erfgs.open(cut) as session:
        assert any("recover" in fault for fault in session.faults)
        assert len(list(session["rgb0"].frames())) > 0


def test_what_a_stream_does_not_hold_is_refused(session):
    with pytest.raises(erfgs.Error, match="'rgb0' of .* has no events"):
        session["rgb0"].events()
    with pytest.raises(erfgs.Error, match="'event0' of .* has no frames"):
        session["event0"].frames()
    with pytest.raises(erfgs.Error, match="'board'"):
        session.slices(1000, ["board"])
    with pytest.raises(KeyError, match="event0, davis"):
        session.slices(1000, ["nobody"])
    with pytest.raises(KeyError):
        session.clock("nobody")
