"""Oracle of the rasteriser: the image of a small set of 3D Gaussians and every gradient, by automatic differentiation.

Written from the equations (EWA splatting; Kerbl et al. 2023) for clarity: every pixel meets every Gaussian, in float64.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

NEGLIGIBLE = 1.0 / 255.0
LARGEST_ALPHA = 0.99
LEAST_TRANSMITTANCE = 1e-4
LOW_PASS = 0.3
# Coefficients of a Gaussian at degree 3, which all questions are brought to, and the number of Gaussians that they are
# filled up to: a program is compiled for sizes, and that takes far longer than computing.
COEFFICIENTS = 48
ROOM = 150


def quaternion_to_matrix(q):
    w, x, y, z = q / jnp.linalg.norm(q)
    # R v = v + 2 w (u x v) + 2 u x (u x v), with u the vector part.
    cross = jnp.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return jnp.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


def harmonics(d):
    """The real spherical harmonics of the unit vector d to degree 3, with the Condon-Shortley phase that 3DGS keeps."""
    x, y, z = d
    pi = np.pi
    e, c = np.sqrt(3 / (4 * pi)), 0.5 * np.sqrt(15 / pi)
    a, b = 0.25 * np.sqrt(35 / (2 * pi)), 0.25 * np.sqrt(21 / (2 * pi))
    return jnp.array(
        [
            0.5 * np.sqrt(1 / pi),
            -e * y,
            e * z,
            -e * x,
            c * x * y,
            -c * y * z,
            0.25 * np.sqrt(5 / pi) * (3 * z * z - 1),
            -c * x * z,
            0.5 * c * (x * x - y * y),
            -a * y * (3 * x * x - y * y),
            0.5 * np.sqrt(105 / pi) * x * y * z,
            -b * y * (5 * z * z - 1),
            0.25 * np.sqrt(7 / pi) * z * (5 * z * z - 3),
            -b * x * (5 * z * z - 1),
            0.25 * np.sqrt(105 / pi) * z * (x * x - y * y),
            -a * x * (x * x - 3 * y * y),
        ]
    )


def splat(view, core, sh):
    """One Gaussian in the image: mean, inverse covariance, opacity, colour, depth, whether it is in front."""
    rotation, translation = view["rotation"], view["translation"]
    focal, centre, size = view["focal"], view["centre"], view["size"]
    camera = rotation @ core[0:3] + translation
    in_front = camera[2] > view["near"]
    z = jnp.where(in_front, camera[2], 1.0)
    mean = focal * camera[:2] / z + centre

    axes = quaternion_to_matrix(core[6:10]) * jnp.exp(core[3:6])[None, :]
    covariance = axes @ axes.T
    # The Jacobian of the projection at the mean, which is pulled towards the image where it lies far outside: 15 % of
    # the image's size beyond each border.
    slope = jnp.clip(camera[:2] / z, (-0.15 * size - centre) / focal, (1.15 * size - centre) / focal)
    jacobian = jnp.array(
        [[focal[0] / z, 0.0, -focal[0] * slope[0] / z], [0.0, focal[1] / z, -focal[1] * slope[1] / z]]
    )
    projected = jacobian @ rotation @ covariance @ rotation.T @ jacobian.T + LOW_PASS * jnp.eye(2)
    conic = jnp.linalg.inv(projected)

    eye = -rotation.T @ translation
    direction = core[0:3] - eye
    basis = harmonics(direction / jnp.linalg.norm(direction))
    active = jnp.arange(len(basis)) < (view["sh_degree"] + 1) ** 2
    colour = jnp.maximum(0.5 + jnp.where(active, basis, 0.0) @ sh.reshape(-1, 3), 0.0)
    return mean, conic, jax.nn.sigmoid(core[10]), colour, camera[2], in_front


def render(view, core, sh, exists, shift):
    """Image (r, g, b, transmittance), depth and how near each pixel came to a threshold. `shift` moves the means in the
    image, pixels; its gradient is that of the projected means."""
    mean, conic, opacity, colour, depth, in_front = jax.vmap(splat, (None, 0, 0))(view, core, sh)
    in_front = in_front & exists
    mean = mean + shift
    order = jnp.argsort(depth, stable=True)
    pixels = view["pixels"]

    def blend(state, index):
        image, depths, transmittance, closed, margin = state
        offset = pixels - mean[index]
        power = -0.5 * jnp.einsum("pi,ij,pj->p", offset, conic[index], offset)
        exponent = jnp.log(opacity[index]) + power
        # The bound is not differentiated, d alpha / d exponent is alpha everywhere: opaque splats keep moving.
        bounded = lax.stop_gradient(jnp.minimum(jnp.exp(exponent), LARGEST_ALPHA))
        alpha = bounded * jnp.exp(exponent - lax.stop_gradient(exponent))
        counts = (alpha >= NEGLIGIBLE) & in_front[index] & ~closed
        after = transmittance * (1.0 - alpha)
        ends = counts & (after < LEAST_TRANSMITTANCE)
        taken = counts & ~ends
        weight = jnp.where(taken, alpha * transmittance, 0.0)
        undecided = jnp.where(in_front[index] & ~closed, jnp.abs(alpha / NEGLIGIBLE - 1.0), jnp.inf)
        undecided = jnp.minimum(undecided, jnp.where(counts, jnp.abs(after / LEAST_TRANSMITTANCE - 1.0), jnp.inf))
        state = (
            image + weight[:, None] * colour[index],
            depths + weight * depth[index],
            jnp.where(taken, after, transmittance),
            closed | ends,
            jnp.minimum(margin, undecided),
        )
        return state, None

    count = pixels.shape[0]
    start = (
        jnp.zeros((count, 3)),
        jnp.zeros(count),
        jnp.ones(count),
        jnp.zeros(count, dtype=bool),
        jnp.full(count, jnp.inf),
    )
    (image, depths, transmittance, _, margin), _ = lax.scan(blend, start, order)
    image = image + transmittance[:, None] * view["background"]
    return jnp.concatenate([image, transmittance[:, None]], axis=-1), depths, margin


def loss(differentiated, view, exists, d_image, margin):
    """sum(d_image * image * clear), and with it image, depth and clear."""
    core, sh, delta_core, delta_sh, shift = differentiated
    image, depth, margins = render(view, core + delta_core, sh + delta_sh, exists, shift)
    clear = (margins > margin).astype(jnp.float64)
    return jnp.sum(d_image * image * clear[:, None]), (image, depth, clear)


compiled = jax.jit(jax.grad(loss, has_aux=True))


def padded(rows, height, width):
    """Rows with zeros beside and below."""
    out = np.zeros((height, width))
    for row, values in zip(out, rows):
        row[: len(values)] = values
    return out


def run(question):
    """Answers with image, depth, `clear` (1 where no threshold is near, so that every precision decides alike) and the
    gradients of sum(d_image * image * clear)."""
    asked, options = question["view"], question["options"]
    x, y = np.meshgrid(np.arange(asked["width"]) + 0.5, np.arange(asked["height"]) + 0.5)
    view = {
        "rotation": np.array(asked["rotation"]),
        "translation": np.array(asked["translation"]),
        "focal": np.array([asked["fx"], asked["fy"]]),
        "centre": np.array([asked["cx"], asked["cy"]]),
        "size": np.array([asked["width"], asked["height"]], dtype=np.float64),
        "pixels": np.stack([x.ravel(), y.ravel()], axis=-1),
        "near": options["near"],
        "sh_degree": options["sh_degree"],
        "background": np.array(options["background"]),
    }
    count, rows, width = len(question["core"]), question["delta_rows"], len(question["sh"][0])
    room = -(-count // ROOM) * ROOM
    # Those that fill the room do not exist and are computed all the same: copies of the first.
    core, sh = (question[name] + question[name][:1] * (room - count) for name in ("core", "sh"))
    differentiated = (
        padded(core, room, 12),
        padded(sh, room, COEFFICIENTS),
        padded(question["delta_core"], room, 12),
        padded(question["delta_sh"], room, COEFFICIENTS),
        np.zeros((room, 2)),
    )
    exists = np.arange(room) < count
    gradients, seen = compiled(differentiated, view, exists, np.array(question["d_image"]), question["margin"])
    d_core, d_sh, d_delta_core, d_delta_sh, d_mean2d = gradients
    return dict(zip(("image", "depth", "clear"), seen)) | {
        "d_core": d_core[:count],
        "d_sh": d_sh[:count, :width],
        "d_delta_core": d_delta_core[:rows],
        "d_delta_sh": d_delta_sh[:rows, :width],
        "d_mean2d": d_mean2d[:count],
    }
