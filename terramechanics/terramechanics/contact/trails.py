# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How far a wheel is from a trail on the ground, and which part of its width is on it.

The functions take NumPy arrays or torch tensors: the simulator has batches of rovers in torch, the
estimator has no torch.
"""

from collections.abc import Callable
from typing import Any, TypeVar

Array = TypeVar("Array", bound=Any)


def beside(off: Array, way: Array, length: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Return how far places are from straight stretches [m], and where along them they are [1].

    ``off`` [..., 2] [m] leads from the begin of each stretch to the place, ``way`` [..., 2] [m] to
    its end; ``length`` gives the lengths [...] of vectors. Along a stretch, 0 is its begin and 1
    its end; a place may be outside.
    """
    share = (off * way).sum(-1) / (way * way).sum(-1).clip(1e-12)
    return length(off - share.clip(0.0, 1.0)[..., None] * way), share


def covered(distance: Array, width: float) -> Array:
    """Return which part [1] of a wheel's ``width`` [m] is on a trail of equal width."""
    return (1.0 - distance / width).clip(0.0)


def passed(distance: Array, share: Array, least: Array, near: float) -> Array:
    """Return on which stretches [...] a wheel rolled at a place: the last left it as it is now.

    ``distance`` [m] and ``share`` [1] are those of :func:`beside`; ``least`` [..., 1] [m] is the
    least distance of a trail. Beside stretches that count the place is by at most ``near`` [m]
    more.
    """
    within = (share >= 0.0) & (share < 1.0) & (distance <= least + near)
    return within | (distance == least)
