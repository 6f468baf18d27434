"""Rigs: projections against the equations written again with NumPy."""

import json
import pickle

import numpy as np
import pytest

import erfgs

K = [-0.21, 0.04, 8e-4, -5e-4, 0.01, 0.0, 0.0, 0.0]
FISHEYE = [0.02, -0.006, 0.001, 0.0]


def camera(name, distortion, **more):
    return {
        "name": name,
        "modality": "both",
        "intrinsics": {"width": 64, "height": 48, "fx": 60.0, "fy": 58.0, "cx": 33.0, "cy": 23.5, "distortion": distortion},
        **more,
    }


@pytest.fixture
def rig(tmp_path):
    half = np.sqrt(0.5)
    # A quarter turn about y.
    pose = {"rotation_wxyz": [half, 0.0, half, 0.0], "translation_m": [0.1, -0.2, 2.0]}
    sigma = {"intrinsics": {"fx": 0.3}, "centre_m": [1e-3, None, 2e-3], "rotation_deg": [0.1, 0.1, 0.2]}
    file = {
        "format": "erfgs-rig",
        "version": 1,
        "method": "board",
        "metric": True,
        "cameras": [
            camera("left", {"brown_conrady": K}, pose=pose, sigma=sigma, time_offset_s=25e-6),
            camera("right", {"kannala_brandt": FISHEYE}, pose=pose),
            camera("lens", "none"),
        ],
        "warnings": ["few observations"],
    }
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(file))
    return erfgs.Rig.load(path)


def seen(points):
    """Points in the camera's axes."""
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    return points @ turn.T + [0.1, -0.2, 2.0]


def brown_conrady(points):
    x, y = (points[:, :2] / points[:, 2:]).T
    k1, k2, p1, p2, k3 = K[:5]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([60 * u + 33, 58 * v + 23.5], 1)


def kannala_brandt(points):
    r = np.hypot(points[:, 0], points[:, 1])
    theta = np.arctan2(r, points[:, 2])
    bent = theta * (1 + sum(k * theta ** (2 * n + 2) for n, k in enumerate(FISHEYE)))
    u, v = points[:, 0] / r * bent, points[:, 1] / r * bent
    return np.stack([60 * u + 33, 58 * v + 23.5], 1)


def test_cameras_are_as_the_file_has_them(rig):
    assert list(rig) == ["left", "right", "lens"] == list(rig.cameras) and "left" in rig and len(rig) == 3
    left = rig["left"]
    assert (left.width, left.height, left.model, left.coefficients) == (64, 48, "brown-conrady", K)
    assert np.array_equal(left.matrix, [[60, 0, 33], [0, 58, 23.5], [0, 0, 1]])
    assert left.sigma == {"centre": (1e-3, None, 2e-3), "rotation": (0.1, 0.1, 0.2), "fx": 0.3}
    assert left.time_offset == pytest.approx(25) and rig["right"].sigma == {}
    assert np.allclose(left.rotation @ np.array(left.centre) + left.translation, 0)
    assert (rig.method, rig.is_metric, rig.rms, rig.warnings) == ("board", True, None, ["few observations"])
    assert rig["right"].model == "kannala-brandt" and rig["lens"].model == "pinhole"


@pytest.mark.parametrize("name, model", [("left", brown_conrady), ("right", kannala_brandt)])
def test_points_are_projected_as_the_equations_say_and_rays_lead_back(rig, name, model):
    points = np.random.default_rng(1).uniform([-1.0, -0.6, -0.7], [1.0, 0.6, 0.7], (500, 3))
    camera, expected = rig[name], model(seen(points))
    pixels = camera.project(points)
    assert pixels.shape == (500, 2) and np.abs(pixels - expected).max() < 1e-9
    rays = camera.rays(pixels)
    towards = points - np.array(camera.centre)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    assert np.abs(rays - towards).max() < 1e-8
    assert np.array_equal(camera.project([[0, 0, 1]]), camera.project(np.array([[0, 0, 1]], np.float32)))


def test_what_no_camera_sees_is_nan_and_wrong_shapes_are_refused(rig):
    behind = seen(np.array([[3.0, 0.0, 0.0]]))
    assert behind[0, 2] < 0 and np.isnan(rig["left"].project([[3.0, 0.0, 0.0]])).all()
    with pytest.raises(ValueError, match=r"shape \(n, 3\)"):
        rig["left"].project([[1.0, 2.0]])
    with pytest.raises(ValueError, match=r"\(48, 64\) or \(48, 64, 3\)"):
        rig["left"].undistort(np.zeros((64, 48), np.uint8))
    with pytest.raises(erfgs.Error, match="camera lens stands"):
        rig["lens"].project([[0.0, 0.0, 1.0]])
    with pytest.raises(KeyError, match="left, right, lens"):
        rig["middle"]


def test_pictures_and_pixels_are_undistorted_to_one_pinhole(rig):
    left = rig["left"]
    pinhole = left.pinhole()
    assert pinhole.model == "pinhole" and (pinhole.width, pinhole.height) == (64, 48)
    points = np.random.default_rng(2).uniform([-0.3, -0.3, -0.3], 0.3, (50, 3))
    assert np.allclose(left.undistort_pixels(left.project(points)), pinhole.project(points), atol=1e-8)
    # A picture whose levels are its pixels' places tells where each pixel of the pinhole was taken from.
    y, x = np.mgrid[0:48, 0:64]
    places = np.stack([4 * x, 4 * y, np.full_like(x, 9)], 2).astype(np.uint8)
    taken = left.undistort(places)
    centres = np.stack([x.ravel() + 0.5, y.ravel() + 0.5], 1)
    inner = (x > 8) & (x < 56) & (y > 8) & (y < 40)
    rays = pinhole.rays(centres) + np.array(left.centre)
    source = left.project(rays).reshape(48, 64, 2) - 0.5
    assert np.abs(taken[..., :2].astype(float) / 4 - source)[inner].max() < 0.2 and (taken[..., 2] == 9).all()
    assert np.array_equal(left.undistort(places[..., 0].copy()), taken[..., 0])


def test_rigs_pickle_and_bad_files_are_refused(rig, tmp_path):
    again = pickle.loads(pickle.dumps(rig))
    assert again["left"].coefficients == K
    wrong = json.loads(rig.path.read_text())
    wrong["cameras"][0]["intrinsics"]["fx"] = -1
    (tmp_path / "wrong.json").write_text(json.dumps(wrong))
    with pytest.raises(erfgs.Error, match="wrong.json.*camera left"):
        erfgs.Rig.load(tmp_path / "wrong.json")
    with pytest.raises(erfgs.Error, match="none.json"):
        erfgs.Rig.load(tmp_path / "none.json")
