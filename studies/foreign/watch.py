# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the estimator's model does at the end of a block, watched from outside."""

from typing import Any, NamedTuple, cast

import torch
from torch import Tensor

from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.state import State
from terrain_estimator.model.torchscript import torchscript_model


class Closed(NamedTuple):
    """A closed block, whether the estimator keeps it or not."""

    before: State
    packed: Tensor  # [n, P] its observations
    after: State


class Watched:
    """A model's module that remembers the last block that it closed."""

    def __init__(self, module: torch.jit.ScriptModule) -> None:
        self._module = module
        self._closed: Closed | None = None

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - any method of the module
        return getattr(self._module, name)

    def update(self, state: State, observation: Tensor) -> State:
        """Return the state after an observation, as the module does."""
        after: State = self._module.update(state, observation)
        if after["closed"].item() > 0.0:
            # an observation that is not linked closes the block before its own
            own = after["block"].shape[0] == 0
            block = state["block"]
            packed = torch.cat([block, observation.unsqueeze(0)]) if own else block
            self._closed = Closed(state, packed, after)
        return after

    def take(self) -> Closed | None:
        """Return the block that was closed since the last call, None where none was."""
        closed, self._closed = self._closed, None
        return closed


def watched(model: LoadedModel) -> tuple[LoadedModel, Watched]:
    """Return the model with a module that remembers, and that module."""
    watch = Watched(model.module)
    return torchscript_model(cast("torch.jit.ScriptModule", watch), model.metadata), watch
