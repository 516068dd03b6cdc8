# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The last seconds of driving, and the sums over them that the tests of consistency need."""

import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from terrain_estimator.observation import Floats

LAGS = 3
"""[seconds of driving] Between two innovations that are compared."""


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
        now, rows, last = self._size, self._rows, 2 + 2 * self._rows
        self._room[now] = second
        # plain numbers: what a second holds is too little for arrays
        numbers = second.tolist()
        there = [math.isfinite(each) for each in numbers[2 + rows :]]
        white = [each if math.isfinite(each) else 0.0 for each in numbers[2 + rows :]]
        self._terms[now] = [*numbers[:2], *white, *there, *[0.0] * (2 * LAGS)]
        for lag, before in enumerate(self._terms[max(0, now - LAGS) : now][::-1]):
            values = before.tolist()
            before[last + lag] = sum(map(operator.mul, values[2 : 2 + rows], white))
            before[last + LAGS + lag] = sum(map(operator.mul, values[2 + rows : last], there))
        self._size += 1

    def told(self, windows: Sequence[int]) -> list[Told]:
        """Return the sums over the last seconds, for each number of them."""
        terms, rows = self._terms[: self._size], self._rows
        sums = np.array([np.add.reduce(terms[-each:]) for each in windows])
        means, numbers = sums[:, 2 : 2 + rows], sums[:, 2 + rows : 2 + 2 * rows]
        squares = (means**2 / np.maximum(numbers, 1.0)).sum(1).tolist()
        present = (numbers > 0.0).sum(1).tolist()
        products = sums[:, 2 + 2 * rows :].reshape(-1, 2, LAGS).sum(2).tolist()
        return [
            Told(distance, int(freedom), square, there, *product)
            for (distance, freedom), square, there, product in zip(
                sums[:, :2].tolist(), squares, present, products, strict=True
            )
        ]


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
