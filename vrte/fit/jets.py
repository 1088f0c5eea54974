"""Numbers with their derivatives: arrays (1 + n, ...), the value first, then what it changes by with each parameter."""

import numpy as np

from vrte.basics.arrays import Array


def multiply_jets(one: Array, other: Array) -> Array:
    """The product, by the product rule.

    >>> multiply_jets(np.array([2.0, 1.0]), np.array([3.0, 0.0])).tolist()
    [6.0, 3.0]
    """
    return np.concatenate([one[:1] * other[:1], one[1:] * other[:1] + one[:1] * other[1:]])


def divide_jets(one: Array, other: Array) -> Array:
    """The quotient, by the quotient rule; 0 over 0 is NaN.

    >>> divide_jets(np.array([1.0, 0.0]), np.array([2.0, 1.0])).tolist()
    [0.5, -0.25]
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        share = one[:1] / other[:1]
        return np.concatenate([share, (one[1:] - share * other[1:]) / other[:1]])


def find_length(one: Array, other: Array) -> Array:
    """The root of the sum of squares; where that is 0, it has no derivative, and 0 stands for it.

    >>> find_length(np.array([3.0, 1.0]), np.array([4.0, 0.0])).tolist()
    [5.0, 0.6]
    """
    length = np.hypot(one[:1], other[:1])
    slope = np.divide(one[:1] * one[1:] + other[:1] * other[1:], length, out=np.zeros_like(one[1:]), where=length > 0.0)
    return np.concatenate([length, slope])


def follow_chain(jet: Array, value: Array, slope: Array) -> Array:
    """A function of a jet, of which its value and its slope there are known, by the chain rule."""
    return np.concatenate([value[None], slope * jet[1:]])
