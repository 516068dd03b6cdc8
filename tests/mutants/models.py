# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The models that torch.jit.script has to compile, whatever a mutant changes in them."""

from collections.abc import Iterator

from torch import nn

from terrain_estimator.learning.adding import Sized, with_effects
from terrain_estimator.learning.restore import physics_alone
from terrain_estimator.model.effects import LAWS
from terrain_estimator.model.model_file import load_model
from terramechanics.presets import load_rover, load_soil


def models() -> Iterator[nn.Module]:
    """Yield a model without effects, and one with every effect that has a law."""
    yield physics_alone(load_rover("mars_rover"), load_soil("loose_sand"), exact=False).eval()
    yield with_effects(load_model(), [Sized.of_library(name) for name in LAWS]).eval()
