"""Oracle of Gaussians that bodies carry: where paths and nodes take them, and the gradients of a loss over them by everything that learns."""

import jax
import jax.numpy as jnp
import numpy as np

# Powers of the way along a stretch against the four control points that decide there.
BASIS = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0


def unit(q):
    return q / jnp.sqrt(jnp.sum(q * q, axis=-1, keepdims=True))


def matrix(q):
    w, x, y, z = q
    return jnp.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def product(a, b):
    w, x, y, z = a
    left = jnp.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    return left @ b


def along(control, stretch):
    """Poses (shift, turn of length 1) of all paths; `control`: knots x paths x 7."""
    first = jnp.clip(jnp.floor(stretch), 0, control.shape[0] - 4).astype(int)
    weights = (stretch - first) ** jnp.arange(4) @ BASIS
    pose = jnp.tensordot(weights, jax.lax.dynamic_slice_in_dim(control, first, 4), 1)
    return pose[:, :3], unit(pose[:, 3:])


def log_presence(gates, question):
    """Of each body: the logarithm of a product of two sigmoids, or nothing where it is always there."""
    begin = jax.nn.log_sigmoid((question["seconds"] - gates[:, 0]) / question["softness"])
    end = jax.nn.log_sigmoid((gates[:, 1] - question["seconds"]) / question["softness"])
    return jnp.where(question["gated"] > 0, begin + end, 0.0)


def carried(row, body, hangs, poses, presences, rests, reaches):
    """A row (place, turn, logit) as its body (a number) and its nodes (four numbers, -1: none) carry it."""
    shifts, turns = poses
    bodies = presences.shape[0]
    place, turn, logit = row[:3], row[3:7], row[7]
    there = hangs >= 0
    nodes = jnp.where(there, hangs, 0)
    rest, shift, node_turn = rests[nodes], shifts[bodies + nodes], turns[bodies + nodes]
    near = -jnp.sum((place - rest) ** 2, axis=1) / (2 * jnp.exp(reaches[nodes]) ** 2)
    # A row that hangs on nothing has finite gradients of what it does not use.
    weights = jax.nn.softmax(jnp.where(there.at[0].set(True), near, -jnp.inf))
    moved = jnp.einsum("kij,kj->ki", jax.vmap(matrix)(node_turn), place - rest) + rest + shift
    # The same half of the sphere as the first node's.
    signs = jnp.where(node_turn @ node_turn[0] < 0, -1.0, 1.0)
    inside = jnp.where(there[0], weights @ moved, place)
    blended = jnp.where(there[0], unit((weights * signs) @ node_turn), jnp.array([1.0, 0.0, 0.0, 0.0]))
    opacity = jax.nn.sigmoid(logit) * jnp.exp(presences[body])
    return jnp.concatenate(
        [
            matrix(turns[body]) @ inside + shifts[body],
            product(product(turns[body], blended), turn),
            jnp.array([jnp.log(opacity) - jnp.log1p(-opacity)]),
        ]
    )


def together(shifts, turns, rests, pairs, weights):
    """What holds nodes together, over pairs of a node and one beside it."""
    rigid, away, alike = weights
    node, beside = pairs[:, 0], pairs[:, 1]
    way = rests[beside] - rests[node]
    turned = jnp.einsum("pij,pj->pi", jax.vmap(matrix)(turns[node]), way)
    error = way + shifts[beside] - shifts[node] - turned
    cosines = jnp.sum(turns[node] * turns[beside], axis=1)
    return rigid * jnp.sum(error**2) + away * jnp.sum(shifts**2) + alike * jnp.sum(1 - cosines**2)


LEARNED = ("rows", "control", "gates", "reaches")


def moment(learned, question, stretch):
    poses = along(learned["control"], stretch)
    presences = log_presence(learned["gates"], question)
    of = lambda row, body, hangs: carried(row, body, hangs, poses, presences, question["rests"], learned["reaches"])  # noqa: E731
    return jax.vmap(of)(learned["rows"], question["body"], question["hangs"])


@jax.jit
def answer(question):
    learned = {name: question[name] for name in LEARNED}
    bodies = question["gates"].shape[0]

    def said(learned, stretch):
        return jnp.sum(question["d_rows"] * moment(learned, question, stretch))

    def loss(learned):
        shifts, turns = along(learned["control"], question["stretch"])
        held = together(shifts[bodies:], turns[bodies:], question["rests"], question["pairs"], question["weights"])
        return said(learned, question["stretch"]) + held

    gradients = jax.grad(loss)(learned)
    by_stretch = jax.grad(said, argnums=1)(learned, question["stretch"])
    now = moment(learned, question, question["stretch"])
    return {"carried": now, "d_stretch": by_stretch} | {f"d_{name}": gradients[name] for name in LEARNED}


def run(question):
    whole = ("body", "hangs", "pairs")
    numbers = {name: np.array(value, float) for name, value in question.items() if name != "oracle" and name not in whole}
    shapes = {"body": (-1,), "hangs": (-1, 4), "pairs": (-1, 2)}
    return answer(numbers | {name: np.array(question[name], int).reshape(shapes[name]) for name in whole})
