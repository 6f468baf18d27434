"""Oracle of Gaussians that are free in time: place and opacity at a moment, and the gradients of a loss over them."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np


def sigmoid(value):
    return 1.0 / (1.0 + jnp.exp(-value))


def through_knots(places, since, spacing):
    """Places (knots before, none, knots after) and tangents, and Hermite's cubic between two of them; a line beyond the last."""
    side = places.shape[0] // 2
    steps = places[1:] - places[:-1]
    inner = 0.5 * (steps[1:] + steps[:-1])
    tangents = jnp.concatenate([2 * steps[:1] - inner[:1], inner, 2 * steps[-1:] - inner[-1:]])
    at = since / spacing + side
    first = jnp.clip(jnp.floor(at), 0, 2 * side - 1).astype(int)
    t = jnp.clip(at - first, 0.0, 1.0)
    beyond = at - first - t
    begin, end, out, into = places[first], places[first + 1], tangents[first], tangents[first + 1]
    cubic = begin + t * (out + t * (3 * (end - begin) - 2 * out - into + t * (2 * (begin - end) + out + into)))
    return cubic + beyond * jnp.where(beyond < 0, out, into)


def bends(places, spacing):
    return (places[2:] - 2 * places[1:-1] + places[:-2]) / spacing**2


def moment(logits, rows, question):
    """What is drawn at the time: how far each Gaussian has moved, and its opacity."""
    since = question["time"] - rows[:, 3:4]
    life = question["least"] + jnp.exp(rows[:, 7])
    presence = jnp.exp(-0.5 * (since[:, 0] / life) ** 2)
    if question["knots"]:
        moved = jax.vmap(through_knots, (0, 0, None))(knots_of(rows, question), since[:, 0], question["spacing"])
    else:
        moved = rows[:, :3] * since + 0.5 * rows[:, 4:7] * since**2
    return moved, sigmoid(logits) * presence


def knots_of(rows, question):
    places = rows.reshape(len(rows), -1, 4)[:, :, :3]
    side = question["knots"]
    return jnp.concatenate([places[:, :side], jnp.zeros((len(rows), 1, 3)), places[:, side:]], axis=1)


def squared_acceleration(rows, question):
    if question["knots"]:
        each = jax.vmap(bends, (0, None))(knots_of(rows, question), question["spacing"])
        return jnp.mean(jnp.sum(each**2, axis=2), axis=1)
    return jnp.sum(rows[:, 4:7] ** 2, axis=1)


def changed_logit(opacity):
    return jnp.log(opacity) - jnp.log1p(-opacity)


@partial(jax.jit, static_argnums=0)
def answer(knots, asked):
    question = asked | {"knots": knots}
    logits, rows, d_moved, d_changed = (question[name] for name in ("logits", "rows", "d_moved", "d_changed"))
    presence = jax.lax.stop_gradient(moment(logits, rows, question)[1] / sigmoid(logits))

    def loss(logits, rows):
        # The instant moves for the sake of the presence alone.
        held = rows.at[:, 3].set(jax.lax.stop_gradient(rows[:, 3]))
        moved, _ = moment(logits, held, question)
        _, opacity = moment(logits, rows, question)
        total = jnp.sum(d_moved * moved) + jnp.sum(d_changed * changed_logit(opacity))
        total += question["weight_presence"] * jnp.mean(presence * sigmoid(logits))
        return total + question["weight_acceleration"] * jnp.mean(squared_acceleration(rows, question))

    d_logits, d_rows = jax.grad(loss, argnums=(0, 1))(logits, rows)
    moved, opacity = moment(logits, rows, question)
    return {"moved": moved, "opacity": opacity, "d_logits": d_logits, "d_rows": d_rows}


def run(question):
    # How many knots there are decides what is computed; all else are numbers.
    asked = {name: np.array(value) for name, value in question.items() if name not in ("oracle", "knots")}
    return answer(question["knots"], asked)
