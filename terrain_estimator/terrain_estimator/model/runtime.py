# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What runs a model: the methods that the estimator calls, on arrays and opaque states."""

from collections.abc import Mapping
from typing import Any, Protocol

from numpy.typing import NDArray

from terrain_estimator.model.report import Report
from terrain_estimator.observation import Floats

RuntimeState = Any
"""A state as a runtime has it; only the runtime that made it reads it."""


class Runtime(Protocol):
    """The model's methods; see ``terrain_estimator.model.palpaca.PAlpaca`` for what they do."""

    name: str

    def initial(self) -> RuntimeState:
        """Return the state at the start, with the model's own prior and no drift."""

    def initial_with_prior(
        self, mean: Floats, sd: Floats, soils: Floats, drift: float
    ) -> RuntimeState:
        """Return the state before the first observation, with a user's prior."""

    def update(self, state: RuntimeState, packed: Floats) -> RuntimeState:
        """Return the state after one packed observation [P]; ``state`` stays as it is."""

    def discard(self, state: RuntimeState) -> RuntimeState:
        """Return the state without the open block."""

    def estimate(self, state: RuntimeState) -> Floats:
        """Return mean and covariance of (c [Pa], tan phi) [3, 2]."""

    def effects(self, state: RuntimeState) -> Floats:
        """Return mean and variance of the size of each of J named effects [J, 2]."""

    def soils(self, state: RuntimeState) -> list[float]:
        """Return the probability of each soil."""

    def report(self, state: RuntimeState) -> Report:
        """Return the report of the last update."""

    def arrays(self, state: RuntimeState) -> dict[str, NDArray[Any]]:
        """Return the tensors of a state by name."""

    def state_of(self, arrays: Mapping[str, NDArray[Any]]) -> RuntimeState:
        """Return the state of these tensors."""

    def publish(self, state: RuntimeState, bank: Mapping[str, NDArray[Any]]) -> RuntimeState:
        """Return the state with another bank, a mapping of its names to arrays."""
