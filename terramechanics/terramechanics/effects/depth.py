# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Laws of sinkage with slip and of the contact's end, which compete with those of ``soil``."""

from typing import ClassVar

from torch import Tensor

from terramechanics.contact.stresses import entry_angle
from terramechanics.effects.law import ExtraValue, Law
from terramechanics.simulation.plant import ContactInputs, with_exit_angle, with_stiffness


class SinkageGrowth(Law):
    """z times 1 + size |i| at the same pressure, Lyasko's linear law."""

    def contact(self, inputs: ContactInputs, values: Tensor, rate: Tensor) -> ContactInputs:
        """Soften the soil with slip; ``values`` in [1]."""
        del rate
        deeper = 1.0 + values * inputs.slip.abs()
        return with_stiffness(inputs, deeper ** (-inputs.constants[..., 0]))


class ExitByEntry(Law):
    """theta_2 = -size (1 + g i) theta_1: a share of the entry angle that may grow with slip.

    g is the extra value; a braked wheel has the share at slip 0. The share ends at 1.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue("growth of the share with slip, over the share", "1", 1.0),
    )

    def contact(self, inputs: ContactInputs, values: Tensor, rate: Tensor) -> ContactInputs:
        """Extend the contact behind the axle; ``values[:, 0]`` in [1]."""
        del rate
        share = values[:, :1] * (1.0 + values[:, 1:] * inputs.slip.clamp(min=0.0))
        return with_exit_angle(
            inputs, share.clamp(0.0, 1.0) * entry_angle(inputs.sinkage, self.radius)
        )
