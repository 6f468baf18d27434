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


def quaternion_to_matrix(q):
    w, x, y, z = q / jnp.linalg.norm(q)
    # R v = v + 2 w (u x v) + 2 u x (u x v), with u the vector part.
    cross = jnp.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return jnp.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


def harmonics(d, degree):
    """The real spherical harmonics of the unit vector d, with the Condon-Shortley phase that 3DGS keeps."""
    x, y, z = d
    pi = np.pi
    basis = [0.5 * np.sqrt(1 / pi)]
    if degree >= 1:
        c = np.sqrt(3 / (4 * pi))
        basis += [-c * y, c * z, -c * x]
    if degree >= 2:
        c = 0.5 * np.sqrt(15 / pi)
        basis += [
            c * x * y,
            -c * y * z,
            0.25 * np.sqrt(5 / pi) * (3 * z * z - 1),
            -c * x * z,
            0.5 * c * (x * x - y * y),
        ]
    if degree >= 3:
        a, b = 0.25 * np.sqrt(35 / (2 * pi)), 0.25 * np.sqrt(21 / (2 * pi))
        basis += [
            -a * y * (3 * x * x - y * y),
            0.5 * np.sqrt(105 / pi) * x * y * z,
            -b * y * (5 * z * z - 1),
            0.25 * np.sqrt(7 / pi) * z * (5 * z * z - 3),
            -b * x * (5 * z * z - 1),
            0.25 * np.sqrt(105 / pi) * z * (x * x - y * y),
            -a * x * (x * x - 3 * y * y),
        ]
    return jnp.array(basis)


def splat(view, options, core, sh):
    """One Gaussian in the image: mean, inverse covariance, opacity, colour, depth, whether it is in front."""
    rotation = jnp.array(view["rotation"])
    camera = rotation @ core[0:3] + jnp.array(view["translation"])
    focal = jnp.array([view["fx"], view["fy"]])
    centre = jnp.array([view["cx"], view["cy"]])
    size = jnp.array([view["width"], view["height"]], dtype=jnp.float64)
    in_front = camera[2] > options["near"]
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

    eye = -rotation.T @ jnp.array(view["translation"])
    direction = core[0:3] - eye
    basis = harmonics(direction / jnp.linalg.norm(direction), options["sh_degree"])
    coefficients = sh[: 3 * len(basis)].reshape(-1, 3)
    colour = jnp.maximum(0.5 + basis @ coefficients, 0.0)
    return mean, conic, jax.nn.sigmoid(core[10]), colour, camera[2], in_front


def render(view, options, core, sh, shift):
    """Image (r, g, b, transmittance), depth and how near each pixel came to a threshold. `shift` moves the means in the
    image, pixels; its gradient is that of the projected means."""
    mean, conic, opacity, colour, depth, in_front = jax.vmap(lambda c, s: splat(view, options, c, s))(core, sh)
    mean = mean + shift
    order = jnp.argsort(depth, stable=True)
    x, y = jnp.meshgrid(jnp.arange(view["width"]) + 0.5, jnp.arange(view["height"]) + 0.5)
    pixels = jnp.stack([x.ravel(), y.ravel()], axis=-1)

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
    image = image + transmittance[:, None] * jnp.array(options["background"])
    return jnp.concatenate([image, transmittance[:, None]], axis=-1), depths, margin


def run(question):
    """Answers with image, depth, `clear` (1 where no threshold is near, so that every precision decides alike) and the
    gradients of sum(d_image * image * clear)."""
    view, options = question["view"], question["options"]
    core = jnp.array(question["core"])
    sh = jnp.array(question["sh"])
    rows = question["delta_rows"]
    delta_core = jnp.array(question["delta_core"]).reshape(rows, core.shape[1])
    delta_sh = jnp.array(question["delta_sh"]).reshape(rows, sh.shape[1])
    d_image = jnp.array(question["d_image"])

    def deformed(core, sh, delta_core, delta_sh):
        return core.at[:rows].add(delta_core), sh.at[:rows].add(delta_sh)

    def forward(core, sh, delta_core, delta_sh, shift):
        return render(view, options, *deformed(core, sh, delta_core, delta_sh), shift)

    shift = jnp.zeros((core.shape[0], 2))
    arguments = (core, sh, delta_core, delta_sh, shift)
    image, depth, margin = jax.jit(forward)(*arguments)
    clear = (margin > question["margin"]).astype(jnp.float64)

    def loss(*arguments):
        image, _, _ = forward(*arguments)
        return jnp.sum(d_image * image * clear[:, None])

    gradients = jax.jit(jax.grad(loss, argnums=(0, 1, 2, 3, 4)))(*arguments)
    names = ("d_core", "d_sh", "d_delta_core", "d_delta_sh", "d_mean2d")
    answer = {"image": image, "depth": depth, "clear": clear}
    return answer | dict(zip(names, gradients))
