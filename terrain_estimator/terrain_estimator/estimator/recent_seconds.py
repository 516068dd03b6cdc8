# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The last seconds of driving, and the sums over them that the tests of consistency need."""

import math
import operator
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from terrain_estimator.observation import Floats

LAGS = 3
"""[seconds of driving] Between two innovations that are compared."""
_NO_PRODUCTS = (0.0,) * (2 * LAGS)


class Told(NamedTuple):
    """Sums over the seconds of a window."""

    distance: float  # [1] of the squared distances
    freedom: int  # degrees of it
    square: float  # [1] squared means of the whitened innovations, times their numbers
    present: int  # rows that were there
    product: float  # [1] products of the whitened innovations of two seconds
    compared: float  # number of these products


class RecentSeconds:
    """At most so many seconds, and what each adds to a sum, which is found once: when it comes.

    A second is an array [2 + 2 R]: squared distance, degrees of freedom, and the innovations of the
    R rows in two forms, alone and whitened. NaN stands for a row that was not there.
    """

    def __init__(self, seconds: Floats, most: int) -> None:
        """Take seconds [n, 2 + 2 R] in order."""
        columns = seconds.shape[1]
        self._most, self._rows, self._size = most, (columns - 2) // 2, len(seconds)
        # in a room for twice as many, in which the last ones move back when it is full
        self._room = np.zeros((max(2 * most, self._size), columns))
        self._terms = np.zeros((len(self._room), columns + 2 * LAGS))
        self._room[: self._size] = seconds
        there = known(seconds[:, 2 + self._rows :])
        products = products_of(there).reshape(self._size, 2 * LAGS)
        self._terms[: self._size] = np.concatenate([seconds[:, :2], *there, products], axis=1)
        # of the last ones, the newest first: the whitened innovations, and which were there
        newest = there[:, : -LAGS - 1 : -1].swapaxes(0, 1)
        self._newest: deque[list[list[float]]] = deque(newest.tolist(), maxlen=LAGS)

    @property
    def seconds(self) -> Floats:
        """The last seconds [n, 2 + 2 R]."""
        return self._room[max(0, self._size - self._most) : self._size]

    def append(self, second: Floats) -> None:
        """Take the next second [2 + 2 R]."""
        if self._size == len(self._room):
            for kept in (self._room, self._terms):
                kept[: self._most] = kept[-self._most :]
            self._size = self._most
        now, last = self._size, 2 + 2 * self._rows
        self._room[now] = second
        # plain numbers: what a second holds is too little for arrays
        distance, freedom, *innovations = second.tolist()
        there = [1.0 if math.isfinite(each) else 0.0 for each in innovations[self._rows :]]
        white = [each if math.isfinite(each) else 0.0 for each in innovations[self._rows :]]
        self._terms[now] = [distance, freedom, *white, *there, *_NO_PRODUCTS]
        for lag, before in enumerate(self._newest):
            product, compared = map(_product, before, (white, there))
            self._terms[now - 1 - lag, last + lag] = product
            self._terms[now - 1 - lag, last + LAGS + lag] = compared
        self._newest.appendleft([white, there])
        self._size += 1

    def told(self, windows: Sequence[int]) -> list[Told]:
        """Return the sums over the last seconds, for each number of them; the numbers rise."""
        starts = [self._size - each for each in reversed(windows)]
        # what each window has beside the one before
        added = np.add.reduceat(self._terms[: self._size], starts)[::-1]
        return [self._told(sums) for sums in np.add.accumulate(added).tolist()]

    def _told(self, sums: list[float]) -> Told:
        """Return the sums by name."""
        rows, last = self._rows, 2 + 2 * self._rows
        numbers = sums[2 + rows : last]
        squares = [
            total * total / number
            for total, number in zip(sums[2 : 2 + rows], numbers, strict=True)
            if number
        ]
        products = sum(sums[last : last + LAGS]), sum(sums[last + LAGS :])
        return Told(sums[0], int(sums[1]), sum(squares), len(squares), *products)


def _product(one: list[float], other: list[float]) -> float:
    return sum(map(operator.mul, one, other))


def known(innovations: Floats) -> Floats:
    """Return innovations [n, R] with 0 for NaN, and 1 where one is known: [2, n, R]."""
    there = np.isfinite(innovations)
    return np.array([np.where(there, innovations, 0.0), there])


def products_of(known: Floats) -> Floats:
    """Return the sums over rows of products over 1, 2, ... LAGS, and their numbers: [n, 2, LAGS].

    ``known`` [2, n, R] is as above. A product stands in the earlier of its two seconds.
    """
    found = np.zeros((known.shape[1], 2, LAGS))
    for lag in range(1, min(LAGS, known.shape[1] - 1) + 1):
        found[:-lag, :, lag - 1] = (known[:, lag:] * known[:, :-lag]).sum(2).T
    return found
