"""Oracle of the event loss: the change of lin-log luma between two renderings against signed event counts."""

import jax
import jax.numpy as jnp
from jax import lax

LUMA = jnp.array([0.299, 0.587, 0.114])
LUMINANCE = jnp.array([0.2126, 0.7152, 0.0722])


def to_linear(encoded):
    """sRGB's transfer function."""
    return jnp.where(encoded <= 0.04045, encoded / 12.92, ((jnp.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4)


def lin_log(rgb, question):
    """Natural logarithm of the grey level of 255, continued below a threshold by a line through the origin."""
    grey = 255.0 * (to_linear(rgb) @ LUMINANCE if question["linear_light"] else rgb @ LUMA)
    threshold = question["lin_log"]
    return jnp.where(grey <= threshold, grey * jnp.log(threshold) / threshold, jnp.log(jnp.maximum(grey, threshold)))


def error(before, after, question):
    """Of each pixel: by how many thresholds the change misses the count."""
    events = jnp.array(question["count"])
    change = (lin_log(after, question) - lin_log(before, question)) / question["threshold"]
    if question["quantise"] == "truncate":
        # Straight-through: truncated forward, identity backward.
        truncated = lax.stop_gradient(jnp.trunc(change)) + (change - lax.stop_gradient(change))
        return truncated - events, jnp.abs(change - jnp.round(change))
    missed = change - events
    if question["quantise"] == "dead-zone":
        beyond = jnp.abs(missed) - 1.0
        return jnp.sign(missed) * jnp.maximum(beyond, 0.0), jnp.abs(beyond)
    return missed, jnp.abs(missed)


def each(before, after, question):
    """The loss of each pixel, and how near it is to a kink."""
    missed, margin = error(before, after, question)
    # |x| with slope 0 at 0, where jax.numpy.abs has slope 1.
    value = missed**2 if question["norm"] == "l2" else missed * lax.stop_gradient(jnp.sign(missed))
    events = jnp.abs(jnp.array(question["count"]))
    weight = 1.0 / jnp.maximum(events, 1.0) if question["confidence"] else 1.0
    return weight * value, margin


def run(question):
    """Answers with the loss of each pixel, `clear` (0 where it is next to a kink, so that precisions may decide
    differently) and the gradients of the sum."""
    before, after = jnp.array(question["before"]), jnp.array(question["after"])
    value, margin = each(before, after, question)
    gradients = jax.grad(lambda b, a: jnp.sum(each(b, a, question)[0]), argnums=(0, 1))(before, after)
    clear = (margin > question["margin"]).astype(jnp.float64)
    return {"each": value, "clear": clear, "d_before": gradients[0], "d_after": gradients[1]}
