# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Decisions that hold for a whole batch, so that code with a branch in it still runs under ``torch.vmap``."""

import torch
from torch import Tensor
from torch._C import _functorch


def any_of(flags: Tensor) -> bool:
    """Whether any of the bool ``flags`` is set; under ``torch.vmap`` whether any is in any of the mapped calls."""
    if torch.jit.is_scripting():  # type: ignore[attr-defined]
        return bool(flags.any())
    return _any_of_mapped(flags)


def _any_of_mapped(flags: Tensor) -> bool:
    """A mapped tensor has no one value, so its wrappers come off; torch's public way, a Function with its own vmap, takes 0.3 ms."""
    while _functorch.is_functorch_wrapped_tensor(flags):
        flags = _functorch.get_unwrapped(flags)
    return bool(flags.any())
