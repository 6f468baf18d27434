"""Oracle of Gaussians that are free in time: place and opacity at a moment, and the gradients of a loss over them."""

import jax
import jax.numpy as jnp


def sigmoid(value):
    return 1.0 / (1.0 + jnp.exp(-value))


def moment(logits, rows, question):
    """What is drawn at the time: how far each Gaussian has moved, and its opacity."""
    since = question["time"] - rows[:, 3:4]
    life = question["least"] + jnp.exp(rows[:, 7])
    presence = jnp.exp(-0.5 * (since[:, 0] / life) ** 2)
    moved = rows[:, :3] * since + 0.5 * rows[:, 4:7] * since**2
    return moved, sigmoid(logits) * presence


def changed_logit(opacity):
    return jnp.log(opacity) - jnp.log1p(-opacity)


def run(question):
    logits = jnp.array(question["logits"])
    rows = jnp.array(question["rows"])
    d_moved = jnp.array(question["d_moved"])
    d_changed = jnp.array(question["d_changed"])
    presence = jax.lax.stop_gradient(moment(logits, rows, question)[1] / sigmoid(logits))

    def loss(logits, rows):
        # The instant moves for the sake of the presence alone.
        held = rows.at[:, 3].set(jax.lax.stop_gradient(rows[:, 3]))
        moved, _ = moment(logits, held, question)
        _, opacity = moment(logits, rows, question)
        total = jnp.sum(d_moved * moved) + jnp.sum(d_changed * changed_logit(opacity))
        total += question["weight_presence"] * jnp.mean(presence * sigmoid(logits))
        return total + question["weight_acceleration"] * jnp.mean(jnp.sum(rows[:, 4:7] ** 2, axis=1))

    d_logits, d_rows = jax.grad(loss, argnums=(0, 1))(logits, rows)
    moved, opacity = moment(logits, rows, question)
    return {"moved": moved, "opacity": opacity, "d_logits": d_logits, "d_rows": d_rows}
