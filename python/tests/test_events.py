"""Event files of other programs: real recordings against digests that another decoder stated, and spans against the whole."""

import hashlib
import json

import numpy as np
import pytest
from conftest import ROOT

import erfgs

DIGESTS = json.loads((ROOT / "events/tests/it/digests.json").read_text())


def digest(array):
    return hashlib.sha3_224(np.ascontiguousarray(array).tobytes()).hexdigest()


@pytest.mark.parametrize("name", ["evt3.raw", "evt2.raw", "gen4.dat", "davis346.aedat4"])
def test_real_recordings_are_what_another_decoder_found(recordings, name):
    expected = DIGESTS[name]
    with erfgs.open(recordings / name) as recording:
        (stream,) = recording.streams.values()
        events = stream.events(clock="device")
    assert events.dtype == erfgs.EVENT_DTYPE and events.dtype.itemsize == 16
    assert events.flags.c_contiguous and events.flags.writeable and len(events) > 50_000
    assert digest(events["t"].astype("<u8")) == expected["t"]
    assert digest(events["x"].astype("<u2")) == expected["x"]
    assert digest(events["y"].astype("<u2")) == expected["y"]
    assert digest(events["p"].astype("u1")) == expected["on"]


def test_spans_are_parts_of_the_whole_and_session_time_begins_with_the_file(recordings):
    with erfgs.open(recordings / "evt3.raw") as recording:
        stream = recording["evt3"]
        device, events = stream.events(clock="device"), stream.events()
        assert np.array_equal(events["t"], device["t"] - device["t"][0]) and events["t"][0] == 0
        assert np.all(np.diff(events["t"]) >= 0) and abs(recording.duration - events["t"][-1]) <= 1
        for start, end in [(None, 70_000), (5_000_000, 5_000_900), (9_999_999, None), (-5, 0), (4, 4)]:
            low = start if start is not None else -1
            high = end if end is not None else 2**62
            within = events[(events["t"] >= low) & (events["t"] < high)]
            assert np.array_equal(stream.events(start, end), within)


def test_slices_of_an_event_file_add_up_to_it(recordings):
    with erfgs.open(recordings / "davis346.aedat4") as recording:
        stream = recording["davis346"]
        whole, frames = stream.events(), list(stream.frames())
        slices = list(recording.slices(33_000))
    assert [s.start for s in slices] == list(range(0, 33_000 * len(slices), 33_000))
    assert np.array_equal(np.concatenate([s.events["davis346"] for s in slices]), whole)
    sliced = [frame for s in slices for frame in s.frames["davis346"]]
    assert len(frames) == 59 and [f.t for f in sliced] == [f.t for f in frames]
    pixels = hashlib.sha3_224()
    for one, other in zip(frames, sliced):
        assert one.image.shape == (260, 346) and one.image.dtype == np.uint8
        assert np.array_equal(one.image, other.image)
        pixels.update(one.image.tobytes())
    assert pixels.hexdigest() == DIGESTS["davis346.aedat4"]["frame"]


def test_events_and_frames_of_one_sensor_see_the_same_thing_at_the_same_time(recordings):
    """Pixels that change between two frames have events between them; their number falls where the frames are taken from elsewhen."""
    with erfgs.open(recordings / "davis346.aedat4") as recording:
        stream = recording["davis346"]
        frames = list(stream.frames())
        pairs = list(zip(frames, frames[1:]))
        change = [np.abs(a.image.astype(int) - b.image) > 40 for a, b in pairs]
        most = max(range(len(pairs)), key=lambda n: change[n].sum())

        def seen(n):
            events = stream.events(pairs[n][0].t, pairs[n][1].t)
            counts = np.zeros(change[most].shape)
            np.add.at(counts, (events["y"], events["x"]), 1)
            return counts[change[most]].mean() / counts.mean()

        assert change[most].sum() > 100 and seen(most) > 3
        assert seen(most) > 2 * np.median([seen(n) for n in range(len(pairs)) if abs(n - most) > 10])


def test_text_and_hints(text_file, tmp_path):
    path, events = text_file
    with erfgs.open(path, size=(64, 48)) as recording:
        stream = recording["known"]
        assert (stream.kind, stream.width, stream.height, stream.packets) == ("events", 64, 48, 0)
        assert np.array_equal(stream.events(clock="device"), events)
    swapped = tmp_path / "swapped.txt"
    swapped.write_text("".join(f"{e['x']} {e['y']} {e['p']} {e['t'] / 1e6:.6f}\n" for e in events))
    with erfgs.open(swapped, columns="x,y,p,t_s") as recording:
        assert np.array_equal(recording["swapped"].events(clock="device"), events)
    with pytest.raises(ValueError, match="write what each column is"):
        erfgs.open(swapped, columns="x,y,colour")


def test_frames_of_16_bits_that_leave_their_depth_open_are_asked_for(recordings):
    with erfgs.open(recordings / "test_data_gray16.aedat4") as recording:
        (stream,) = recording.streams.values()
        told = None
        try:
            frames = list(stream.frames(depth=16))
        except erfgs.Error as error:
            told = str(error)
            frames = list(stream.frames(depth=16, bits=16))
        assert told is None or "16 bits" in told
        assert frames and all(frame.image.dtype == np.uint16 for frame in frames)


def test_errors_are_the_programs_own_words(tmp_path, text_file):
    with pytest.raises(erfgs.Error, match="No such file"):
        erfgs.open(tmp_path / "none.raw")
    (tmp_path / "noise.bin").write_bytes(bytes(range(256)) * 8)
    with pytest.raises(erfgs.Error, match="noise.bin"):
        erfgs.open(tmp_path / "noise.bin")
    recording = erfgs.open(text_file[0])
    with pytest.raises(KeyError, match="there are known"):
        recording["left"]
    with pytest.raises(erfgs.Error, match="the file of one camera"):
        recording.clock("known")
    with pytest.raises(ValueError, match='"session" or "device"'):
        recording["known"].events(clock="host")
    with pytest.raises(ValueError, match="8 or 16"):
        recording["known"].frames(depth=12)
    with pytest.raises(erfgs.Error, match="above 0"):
        recording.slices(0)
    with pytest.raises(ValueError, match="292 years"):
        recording["known"].events(2**62)
    with pytest.raises(ValueError, match="holds nothing"):
        recording.slice(5, 5)
    recording.close()
    with pytest.raises(erfgs.Error, match="is closed"):
        recording["known"].events()
