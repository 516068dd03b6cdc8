# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The models that the foreign drives are judged with: the one that ships, and a control.

The control is the best case for this project on Chrono's SCM: physics alone, its prior around
SCM's own n, k_c, k_phi and K, and the largest stress where SCM has it, below the axle (c1 near 0,
c2 = 0). As every trained model it takes the constants as known within 5 %. What is left between the
two laws is their form.
"""

from pathlib import Path

from studies.physics import physics_model
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.model_file import load_model
from terramechanics.presets import load_rover
from terramechanics.terrain.soil import Soil

SHIPPED, CONTROL = "shipped", "control"
MODELS = (SHIPPED, CONTROL)
SCM_SAND = Soil(
    "scm_sand",
    n=1.1,
    k_c=900.0,
    k_phi=1523400.0,
    shear_modulus=0.025,
    c1=0.02,  # for SCM's 0, which Soil refuses
    c2=0.0,
    cohesion=800.0,
    tan_phi=0.6,
)
"""Constants of both soils of the logs."""


def judged_model(name: str, folder: Path) -> LoadedModel:
    """Return one of MODELS; the control is written to ``folder`` first."""
    if name == SHIPPED:
        return load_model("mars_rover")
    return physics_model(load_rover("mars_rover"), [SCM_SAND], folder / "scm_control.pt")
