# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A compiled core as the runtime of a model."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.compiled.core import CompiledModel, CompiledState
from terrain_estimator.model.report import CLOSED, PUBLISHED, SCALARS, Report, report_of
from terrain_estimator.observation import Floats

_NONE = np.zeros(0)


class CompiledRuntime:
    """See ``terrain_estimator.model.runtime``."""

    name = "compiled"

    def __init__(self, core: CompiledModel) -> None:
        """Run a core that was found equal to its model."""
        self._core = core
        start = core.initial()
        axles, rows, of_posterior = (
            sum(start[name].size for name in names)
            for names in (("usable",), ("single_misses",), PUBLISHED)
        )
        self._rows = rows
        told = (*SCALARS, "usable", *PUBLISHED, "single_misses", "white_misses")
        every = len(SCALARS) + axles
        self._read = core.reader(told, every + of_posterior + 2 * rows)
        self._update, numbers = core.updater(told, every + of_posterior + 2 * rows)
        self._told, self._posterior, self._misses = np.split(numbers, [every, every + of_posterior])
        self._numbers, self._last = numbers, start
        numbers[:] = self._read(start)
        self._soils = core.reader(("soils",), start["soils"].size)

    def initial(self) -> CompiledState:
        """Return the state at the start, with the model's own prior and no drift."""
        return self._core.initial()

    def initial_with_prior(
        self, mean: Floats, sd: Floats, soils: Floats, drift: float
    ) -> CompiledState:
        """Return the state before the first observation, with a user's prior."""
        return self._core.initial_with_prior(mean, sd, soils, drift)

    def update(self, state: CompiledState, packed: Floats) -> CompiledState:
        """Return the state after one packed observation [P]."""
        self._last = self._update(state, packed)
        return self._last

    def discard(self, state: CompiledState) -> CompiledState:
        """Return the state without the open block."""
        return self._core.discard(state)

    def estimate(self, state: CompiledState) -> Floats:
        """Return mean and covariance of (c [Pa], tan phi) [3, 2]."""
        return self._core.estimate(state)

    def effects(self, state: CompiledState) -> Floats:
        """Return mean and variance of the size of each of J named effects [J, 2]."""
        return self._core.effects(state)

    def soils(self, state: CompiledState) -> list[float]:
        """Return the probability of each soil."""
        probabilities: list[float] = self._soils(state).tolist()
        return probabilities

    def report(self, state: CompiledState) -> Report:
        """Return the report of the last update."""
        if state is not self._last:
            self._numbers[:] = self._read(state)
            self._last = state
        numbers: list[float] = self._told.tolist()
        waiting, published, misses = 0, 0.0, (_NONE, _NONE)
        if numbers[CLOSED] > 0.0:
            waiting = self._core.length(state, "block")
            published = sum(self._posterior.tolist())
            own = self._misses.copy()
            misses = own[: self._rows], own[self._rows :]
        usable = [value > 0.0 for value in numbers[len(SCALARS) :]]
        return report_of(numbers[: len(SCALARS)], usable, waiting, published, misses)

    def arrays(self, state: CompiledState) -> dict[str, NDArray[Any]]:
        """Return the tensors of a state by name."""
        return dict(state)

    def state_of(self, arrays: Mapping[str, NDArray[Any]]) -> CompiledState:
        """Return the state of these tensors."""
        return self._core.state_of(arrays)

    def publish(self, state: CompiledState, bank: Mapping[str, NDArray[Any]]) -> CompiledState:
        """Return the state with another bank, a mapping of its names to arrays."""
        return self._core.publish(state, bank)
