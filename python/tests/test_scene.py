"""Reconstructions: what is drawn, against NumPy's own drawing of the Gaussians and against the pictures of a held-out camera."""

import multiprocessing
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import erfgs


@pytest.fixture(scope="module")
def scene(trained):
    return erfgs.Scene.open(trained[1])


@pytest.fixture(scope="module")
def opened(trained):
    return erfgs.Dataset.load(trained[0])


def psnr(a, b):
    return -10 * np.log10(np.mean((a / 255.0 - b / 255.0) ** 2))


def drawn(gaussians, camera):
    """Gaussians as published 3DGS draws them, in float64: the image in [0, 1] over black, the opacity and the depth."""
    means, quaternions, scales, opacities, harmonics = (array.astype(float) for array in gaussians)
    turn, focal = camera.rotation, camera.matrix[[0, 1], [0, 1]]
    places = means @ turn.T + camera.translation
    w, x, y, z = quaternions.T
    axes = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    directions = means - camera.centre
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    basis = np.stack([np.full(len(means), 0.28209479), *(0.48860251 * directions.T[[1, 2, 0]] * np.array([[-1], [1], [-1]]))], 1)
    colours = np.maximum(np.einsum("nk,nkc->nc", basis[:, : harmonics.shape[1]], harmonics[:, :4]) + 0.5, 0)
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    image, passes, depth = np.zeros((camera.height, camera.width, 3)), np.ones((camera.height, camera.width)), np.zeros_like(columns)
    for at in np.argsort(places[:, 2]):
        px, py, pz = places[at]
        # As 3DGS: no slope beyond 1.3 times the image's edge.
        edges = [camera.width / (2 * focal[0]), camera.height / (2 * focal[1])]
        sx, sy = (np.clip(p / pz, -1.3 * edge, 1.3 * edge) for p, edge in zip((px, py), edges))
        slope = np.array([[focal[0] / pz, 0, -focal[0] * sx / pz], [0, focal[1] / pz, -focal[1] * sy / pz]])
        spread = turn @ axes[at] @ np.diag(scales[at])
        covariance = slope @ spread @ spread.T @ slope.T + 0.3 * np.eye(2)
        # A Gaussian that reaches behind the near plane is not drawn.
        if pz - 3 * np.linalg.norm(spread[2]) < 0 or opacities[at] < 1 / 255:
            continue
        off = np.stack([columns - (focal[0] * px / pz + camera.matrix[0, 2]), rows - (focal[1] * py / pz + camera.matrix[1, 2])])
        power = np.einsum("ixy,ij,jxy->xy", off, np.linalg.inv(covariance), off)
        alpha = np.minimum(opacities[at] * np.exp(-0.5 * power), 0.99)
        alpha[(alpha < 1 / 255) | (passes < 1e-4)] = 0
        image += (passes * alpha)[..., None] * colours[at]
        depth += passes * alpha * pz
        passes *= 1 - alpha
    covered = 1 - passes
    return image, covered, np.divide(depth, covered, out=np.zeros_like(depth), where=covered > 0.01)


def test_what_is_drawn_is_what_the_gaussians_say(scene):
    camera, (start, end) = scene.cameras["test00"], scene.span
    for t in (start, (start + end) // 2, end):
        image, opacity, depth = drawn(scene.gaussians(t), camera)
        found = scene.render("test00", t)
        assert found.image.shape == (48, 64, 3) and found.image.dtype == np.uint8 and found.image.std() > 10
        assert found.opacity.shape == found.depth.shape == (48, 64)
        # Near planes leave out a few Gaussians that a drawing by the book has.
        off = np.abs(found.image / 255.0 - np.clip(image, 0, 1)).max(axis=2)
        assert np.median(off) < 0.003 and np.mean(off > 0.02) < 0.02, (np.median(off), np.mean(off > 0.02))
        assert np.mean(np.abs(found.opacity - opacity) > 0.01) < 0.02
        solid = opacity > 0.5
        assert solid.mean() > 0.5 and np.mean(np.abs(found.depth / depth - 1)[solid] > 0.03) < 0.02


def test_a_held_out_camera_sees_what_it_saw(scene, opened):
    assert scene.held_out == ["test00"] and set(scene.cameras) == set(opened)
    of = opened["test00"]
    values = [psnr(of.image(index), scene.render("test00", frame.t).image) for index, frame in enumerate(of.frames)]
    grey = [psnr(of.image(index), np.full_like(of.image(index), of.image(index).mean())) for index in range(len(of.frames))]
    assert np.mean(values) > np.mean(grey) + 3, (values, grey)
    # By the dataset's camera as by its name.
    again = scene.render(of.camera, of.frames[0].t)
    assert np.array_equal(again.image, scene.render("test00", of.frames[0].t).image)


def test_rows_are_the_same_gaussians_at_all_times(scene):
    first, last = (scene.gaussians(t) for t in scene.span)
    assert len(first.means) == scene.count > scene.moving_count > 0
    for a, b in zip(first, last):
        assert a.dtype == np.float32 and len(a) == scene.count and np.isfinite(a).all()
        assert np.array_equal(a[scene.moving_count :], b[scene.moving_count :])
    assert not np.array_equal(first.opacities, last.opacities) or not np.array_equal(first.means, last.means)
    assert np.allclose(np.linalg.norm(first.quaternions, axis=1), 1, atol=1e-5) and (first.scales > 0).all()
    assert first.harmonics.shape[1:] in [(1, 3), (4, 3)] and (first.opacities >= 0).all() and (first.opacities <= 1).all()


def test_scenes_pickle_and_serve_threads(scene):
    times = np.linspace(*scene.span, 6).astype(int).tolist()
    expected = [scene.render("rgb00", t).image for t in times]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda t: scene.render("rgb00", t).image, times))
    again = pickle.loads(pickle.dumps(scene))
    assert all(np.array_equal(a, b) for a, b in zip(found, expected))
    assert np.array_equal(again.render("rgb00", times[2]).image, expected[2]) and again.adapter == scene.adapter


def in_child(scene, pipe):
    try:
        scene.render("rgb00", scene.span[0])
    except erfgs.Error as error:
        pipe.send(str(error))
    else:
        pipe.send("drawn")


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_is_told_to_open_it_itself(scene):
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe()
    child = context.Process(target=in_child, args=(scene, there))
    child.start()
    assert here.poll(60) and "opened by another process" in here.recv()
    child.join(60)


def test_what_cannot_be_drawn_is_refused(scene, trained):
    start, end = scene.span
    with pytest.raises(ValueError, match=f"goes from {start} to {end} microseconds"):
        scene.render("test00", end + 1)
    with pytest.raises(ValueError, match="outside of the recording"):
        scene.gaussians(start - 1)
    with pytest.raises(KeyError, match="no camera 'nobody'; there are .*test00"):
        scene.render("nobody", start)
    with pytest.raises(TypeError):
        scene.render(3, start)
    with pytest.raises(erfgs.Error, match="check that this is the folder of a run"):
        erfgs.Scene.open(trained[0])
    with pytest.raises(erfgs.Error, match="no Vulkan.* adapter was found"):
        erfgs.Scene.open(scene.path, adapter="no such adapter")
