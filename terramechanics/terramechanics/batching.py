# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Decisions that hold for a whole batch, so that code with a branch in it still runs under ``torch.vmap``."""

from typing import Any

import torch
from torch import Tensor


class _Any(torch.autograd.Function):
    """``any`` over everything, under ``torch.vmap`` over the mapped dimension, too: its result is not mapped."""

    @staticmethod
    def forward(flags: Tensor) -> Tensor:
        return flags.any()

    @staticmethod
    def setup_context(ctx: Any, inputs: tuple[Any, ...], output: Any) -> None:  # noqa: ANN401 (types of torch)
        """Nothing is kept: flags have no gradient."""

    @staticmethod
    def vmap(_info: Any, _in_dims: tuple[Any, ...], flags: Tensor) -> tuple[Tensor, None]:  # noqa: ANN401
        return _Any.apply(flags), None  # type: ignore[no-untyped-call]


def any_of(flags: Tensor) -> bool:
    """Whether any of the bool ``flags`` is set; under ``torch.vmap`` whether any is in any of the mapped calls."""
    if torch.jit.is_scripting():  # type: ignore[attr-defined]
        return bool(flags.any())
    return _any_of_mapped(flags)


def _any_of_mapped(flags: Tensor) -> bool:
    try:
        return bool(flags.any())
    except RuntimeError:  # a mapped tensor has no one value; asking first would cost every other call 15 us
        return bool(_Any.apply(flags))  # type: ignore[no-untyped-call]
