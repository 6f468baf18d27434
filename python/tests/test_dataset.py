"""Datasets: what the stage's film holds, against its files read without erfgs."""

import json
import pickle

import numpy as np
import pytest

import erfgs


@pytest.fixture(scope="module")
def opened(dataset):
    return erfgs.Dataset.load(dataset)


@pytest.fixture(scope="module")
def manifest(dataset):
    return json.loads((dataset / "dataset.json").read_text())


def test_cameras_and_frames_are_those_of_the_manifest(opened, manifest):
    assert list(opened) == [camera["name"] for camera in manifest["cameras"]] == list(opened.cameras)
    assert opened.span == tuple(t // 1000 for t in manifest["span_ns"])
    for of in manifest["cameras"]:
        camera = opened[of["name"]]
        assert (camera.split, camera.modality) == (of["split"], of["modality"])
        assert [f.t for f in camera.frames] == [f["t_ns"] // 1000 for f in of["frames"]]
        assert [f.exposure for f in camera.frames] == [tuple(t // 1000 for t in f["exposure_ns"]) for f in of["frames"]]
        intrinsics = of["intrinsics"]
        assert camera.camera.matrix[0, 0] == intrinsics["fx"] and camera.camera.width == intrinsics["width"] == 64
        assert np.allclose(camera.camera.translation, of["world_to_camera"]["translation_m"])
        for index in range(len(camera.frames)):
            image, mask = camera.image(index), camera.mask(index)
            assert image.shape == (48, 64, 3) and image.dtype == np.uint8 and image.std() > 5
            assert mask is None or (mask.shape == (48, 64) and set(np.unique(mask)) <= {0, 255})


def test_events_and_counts_are_those_of_the_archive(opened, manifest, dataset):
    (of,) = [camera for camera in manifest["cameras"] if camera.get("events")]
    camera, stored = opened[of["name"]], np.load(dataset / of["events"]["file"])
    events = camera.events()
    assert events.dtype == erfgs.EVENT_DTYPE and len(events) == of["events"]["count"] > 1000
    for field, name in [("t", "t"), ("x", "x"), ("y", "y"), ("p", "p")]:
        assert np.array_equal(events[field], stored[name])
    start, end = 20_000, 60_000
    within = events[(events["t"] >= start) & (events["t"] < end)]
    assert np.array_equal(camera.events(start, end), within)
    counts = camera.counts(start, end)
    assert counts.shape == (2, 48, 64) and counts.dtype == np.int32 and counts.sum() == len(within) > 100
    expected = np.zeros_like(counts)
    np.add.at(expected, (within["p"], within["y"], within["x"]), 1)
    assert np.array_equal(counts, expected)
    assert camera.counts(60_000, 20_000).sum() == 0


def test_datasets_pickle_and_what_lacks_is_refused(opened, dataset, tmp_path):
    again, camera = pickle.loads(pickle.dumps((opened, opened["rgb00"])))
    assert again.span == opened.span and np.array_equal(camera.image(0), opened["rgb00"].image(0))
    with pytest.raises(erfgs.Error, match="rgb00 has no events"):
        opened["rgb00"].counts(0, 1)
    with pytest.raises(IndexError, match="none of index 99"):
        opened["rgb00"].image(99)
    with pytest.raises(KeyError, match="rgb00"):
        opened["nobody"]
    with pytest.raises(erfgs.Error, match="holds no dataset.json"):
        erfgs.Dataset.load(tmp_path)
    points = opened.points()
    assert points is None or points[0].shape == points[1].shape
