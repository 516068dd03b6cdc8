# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A TorchScript module behind arrays; it is the reference of every other runtime."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from terrain_estimator.model.bank import Bank
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import Metadata
from terrain_estimator.model.report import CLOSED, PUBLISHED, SCALARS, Report, report_of
from terrain_estimator.model.state import State
from terrain_estimator.observation import Floats

_NONE = np.zeros(0)


@contextmanager
def running() -> Iterator[None]:
    """Run the methods of a module without gradients and without torch's optimiser.

    Optimised graphs are a tenth faster, but making them takes every process 3 s and 80 MB.
    """
    as_written = torch.jit.optimized_execution(should_optimize=False)  # type: ignore[attr-defined]
    with torch.inference_mode(), as_written:
        yield


class TorchScriptRuntime:
    """See ``terrain_estimator.model.runtime``."""

    name = "torchscript"

    def __init__(self, module: torch.jit.ScriptModule) -> None:
        """Run the methods of ``module``."""
        self._module = module

    def initial(self) -> State:
        """Return the state at the start, with the model's own prior and no drift."""
        with running():
            state: State = self._module.initial()
        return state

    def initial_with_prior(self, mean: Floats, sd: Floats, soils: Floats, drift: float) -> State:
        """Return the state before the first observation, with a user's prior."""
        given = (torch.from_numpy(np.asarray(x, dtype=np.float64)) for x in (mean, sd, soils))
        with running():
            state: State = self._module.initial_with_prior(*given, drift)
        return state

    def update(self, state: State, packed: Floats) -> State:
        """Return the state after one packed observation [P]."""
        with running():
            after: State = self._module.update(state, torch.from_numpy(packed))
        return after

    def discard(self, state: State) -> State:
        """Return the state without the open block."""
        with running():
            after: State = self._module.discard(state)
        return after

    def estimate(self, state: State) -> Floats:
        """Return mean and covariance of (c [Pa], tan phi) [3, 2]."""
        with running():
            values: Floats = self._module.estimate(state).numpy()
        return values

    def effects(self, state: State) -> Floats:
        """Return mean and variance of the size of each of J named effects [J, 2]."""
        with running():
            sizes: Floats = self._module.effects(state).numpy()
        return sizes

    def soils(self, state: State) -> list[float]:
        """Return the probability of each soil."""
        probabilities: list[float] = state["soils"].tolist()
        return probabilities

    def report(self, state: State) -> Report:
        """Return the report of the last update."""
        scalars = [state[name].item() for name in SCALARS]
        waiting, published, misses = 0, 0.0, (_NONE, _NONE)
        if scalars[CLOSED] > 0.0:
            waiting = len(state["block"])
            published = sum(state[name].sum().item() for name in PUBLISHED)
            misses = (state["single_misses"].numpy(), state["white_misses"].numpy())
        return report_of(scalars, state["usable"].tolist(), waiting, published, misses)

    def arrays(self, state: State) -> dict[str, NDArray[Any]]:
        """Return the tensors of a state by name."""
        return {name: value.numpy() for name, value in state.items()}

    def state_of(self, arrays: Mapping[str, NDArray[Any]]) -> State:
        """Return the state of these tensors."""
        return {name: torch.from_numpy(np.array(value)) for name, value in arrays.items()}

    def publish(self, state: State, bank: Mapping[str, NDArray[Any]]) -> State:
        """Return the state with another bank, a mapping of its names to arrays."""
        with running():
            after: State = self._module.publish(state, Bank(**self.state_of(bank)))
        return after


def torchscript_model(module: torch.jit.ScriptModule, metadata: Metadata) -> LoadedModel:
    """Return a model that TorchScript runs."""
    return LoadedModel(metadata, TorchScriptRuntime(module), module)
