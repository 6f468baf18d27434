"""Oracle of the event loss: the change of lin-log luma between two renderings against signed event counts."""

import jax
import jax.numpy as jnp
from jax import lax

LUMA = jnp.array([0.299, 0.587, 0.114])


def to_linear(encoded):
    """sRGB's transfer function."""
    return jnp.where(encoded <= 0.04045, encoded / 12.92, ((jnp.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4)


def lin_log(rgb, question):
    """Natural logarithm of the grey level of 255, continued below a threshold by a line through the origin."""
    luma = rgb @ LUMA
    grey = 255.0 * (to_linear(luma) if question["linear_light"] else luma)
    threshold = question["lin_log"]
    return jnp.where(grey <= threshold, grey * jnp.log(threshold) / threshold, jnp.log(jnp.maximum(grey, threshold)))


def loss(before, after, question):
    events = jnp.array(question["count"])
    change = (lin_log(after, question) - lin_log(before, question)) / question["threshold"]
    if question["quantise"] == "truncate":
        # Straight-through: truncated forward, identity backward.
        change = change + lax.stop_gradient(jnp.trunc(change) - change)
        error = change - events
    elif question["quantise"] == "dead-zone":
        error = change - events
        error = jnp.sign(error) * jnp.maximum(jnp.abs(error) - 1.0, 0.0)
    else:
        error = change - events
    value = error**2 if question["norm"] == "l2" else jnp.abs(error)
    weight = 1.0 / jnp.maximum(jnp.abs(events), 1.0) if question["confidence"] else 1.0
    return jnp.sum(weight * value)


def run(question):
    before, after = jnp.array(question["before"]), jnp.array(question["after"])
    value, gradients = jax.value_and_grad(loss, argnums=(0, 1))(before, after, question)
    return {"loss": value, "d_before": gradients[0], "d_after": gradients[1]}
