"""Oracle of the deformation field: HexPlane, trunk and heads (4DGS, Wu et al. 2024), with every gradient."""

from collections import namedtuple
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

PAIRS = ("xy", "xz", "xt", "yz", "yt", "zt")
# Head: column of the core deltas that its first output goes to.
CORE_HEADS = {"position": 0, "scale": 3, "rotation": 6, "opacity": 10}
# What the equations are compiled for.
Form = namedtuple("Form", "levels depth heads sh_stride upper_half")


def sample(plane, u, v):
    """Bilinear interpolation of plane[row, column, feature] at u (columns) and v (rows) in [0, 1], corners aligned."""
    rows, columns = plane.shape[:2]

    def cell(along, cells):
        position = jnp.clip(along, 0.0, 1.0) * (cells - 1)
        low = jnp.clip(jnp.floor(position), 0, cells - 2)
        return low.astype(int), position - low

    column, x = cell(u, columns)
    row, y = cell(v, rows)
    above = (1.0 - x) * plane[row, column] + x * plane[row, column + 1]
    below = (1.0 - x) * plane[row + 1, column] + x * plane[row + 1, column + 1]
    return (1.0 - y) * above + y * below


def linear(parameters, name, value):
    return parameters[name + ".weight"] @ value + parameters[name + ".bias"]


def features(form, parameters, aabb, t01, mean):
    lower, upper = aabb
    t = jnp.clip(t01, 0.0, 1.0)
    at = dict(zip("xyz", (mean - lower) / (upper - lower)))
    at["t"] = 0.5 + 0.5 * t if form.upper_half else t
    levels = []
    for level in range(form.levels):
        product = 1.0
        for pair in PAIRS:
            plane = parameters[f"grid.level{level}.{pair}"]
            product = product * sample(plane, at[pair[0]], at[pair[1]])
        levels.append(product)
    return jnp.concatenate(levels)


def deltas(form, parameters, aabb, t01, mean):
    hidden = features(form, parameters, aabb, t01, mean)
    for layer in range(max(form.depth, 1)):
        if layer > 0:
            hidden = jax.nn.relu(hidden)
        hidden = linear(parameters, f"trunk.{layer}", hidden)
    core = jnp.zeros(12)
    sh = jnp.zeros(form.sh_stride)
    for head in form.heads:
        inner = linear(parameters, f"head.{head}.0", jax.nn.relu(hidden))
        out = linear(parameters, f"head.{head}.1", jax.nn.relu(inner))
        if head == "sh":
            sh = sh.at[: out.shape[0]].set(out)
        else:
            first = CORE_HEADS[head]
            core = core.at[first : first + out.shape[0]].set(out)
    return core, sh


def plane_losses(form, parameters):
    """Second differences of the spatial planes along their rows, of the time planes along time, |1 - p| of the latter."""
    space = time = time_l1 = 0.0
    for level in range(form.levels):
        for pair in PAIRS:
            plane = parameters[f"grid.level{level}.{pair}"]
            smooth = jnp.mean((plane[2:] - 2.0 * plane[1:-1] + plane[:-2]) ** 2)
            if "t" in pair:
                time = time + smooth
                time_l1 = time_l1 + jnp.mean(jnp.abs(1.0 - plane))
            else:
                space = space + smooth
    return space, time, time_l1


@partial(jax.jit, static_argnums=0)
def answer(form, parameters, means, aabb, t01, d_core, d_sh, plane_weights):
    def loss(parameters, means):
        core, sh = jax.vmap(lambda mean: deltas(form, parameters, aabb, t01, mean))(means)
        return jnp.sum(core * d_core) + jnp.sum(sh * d_sh), (core, sh)

    def regulariser(parameters):
        losses = jnp.array(plane_losses(form, parameters))
        return plane_weights @ losses, losses

    (d_parameters, d_means), (core, sh) = jax.grad(loss, argnums=(0, 1), has_aux=True)(parameters, means)
    d_planes, losses = jax.grad(regulariser, has_aux=True)(parameters)
    return {
        "core": core,
        "sh": sh,
        "d_parameters": d_parameters,
        "d_means": d_means,
        "plane_losses": losses,
        "d_planes": d_planes,
    }


def run(question):
    form = Form(*(tuple(value) if isinstance(value, list) else value for value in map(question.get, Form._fields)))
    parameters = {
        name: np.array(entry["values"]).reshape(entry["shape"]) for name, entry in question["parameters"].items()
    }
    asked = (np.array(question[name]) for name in ("means", "aabb", "t01", "d_core", "d_sh", "plane_weights"))
    return answer(form, parameters, *asked)
