# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Another contact law than that of the soil file, as an effect."""

from typing import ClassVar

import torch
from torch import Tensor

from terramechanics.contact.ruts import REBOUND
from terramechanics.contact.scm import scm_forces
from terramechanics.contact.stresses import quadrature
from terramechanics.effects.law import ExtraValue, Law, Readings, with_slip
from terramechanics.simulation.plant import ContactInputs
from terramechanics.vehicle.rover import Rover

SLIP_DOUBT = 0.02
"""[1] Deviation of the slip beside that of its sensor, where all forces are by the law scm.

On ground that the wheels before sheared the force turns over within a small slip, and the law has
it turn at once: within about 3 mm/s of rolling its direction is not to be known from a mean of
0.1 s. Chosen on the shared drives of bags/foreign.
"""


class ScmContact(Law):
    """(1 - size) of the forces by the soil's law and ``size`` by the law scm, ruts included.

    n, k_c, k_phi and K are those of the soil; the rebound is REBOUND times the exponential of the
    extra value.
    """

    extra: ClassVar[tuple[ExtraValue, ...]] = (
        ExtraValue(f"logarithm of the ground's rebound over {REBOUND:g} of the sinkage", "1", 0.5),
    )
    keeps_ruts: ClassVar[bool] = True
    nodes: Tensor

    def __init__(self, rover: Rover, axle: int | None = None) -> None:
        super().__init__(rover, axle)
        self.width, self.rebound, self.doubt = rover.wheel_width, REBOUND, SLIP_DOUBT
        self.register_buffer("nodes", quadrature(4))

    def stresses(self, forces: Tensor, inputs: ContactInputs, values: Tensor) -> Tensor:
        """Put forces of the law scm in the place of a share of these; ``values[:, 0]`` in [1]."""
        rebound = self.rebound * torch.exp(values[:, 1:])
        n, k_c, k_phi, shear_modulus = inputs.constants[..., :4].unbind(-1)
        parts = torch.broadcast_tensors(n, k_c, k_phi, shear_modulus, rebound)  # type: ignore[no-untyped-call]
        constants = torch.stack([parts[0], parts[1], parts[2], parts[3], parts[4]], -1)
        other = scm_forces(
            inputs.slip, inputs.sinkage, constants, self.radius, self.width, self.nodes,
            inputs.exit_angle, inputs.rut,
        )  # fmt: skip
        return forces + (other - forces) * values[:, :1].unsqueeze(-1).unsqueeze(-1)

    def corrected(self, readings: Readings, values: Tensor) -> Readings:
        """Return the readings with a slip that is less certain by SLIP_DOUBT."""
        spread = torch.sqrt(readings.slip_sd**2 + (self.doubt * values[:, :1]) ** 2)
        return with_slip(readings, readings.slip, spread)
