# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The Python model behind a model file, for what a TorchScript module cannot do: torch.vmap and masked rows."""

from terrain_estimator.learning.training import build_model
from terrain_estimator.model_file import LoadedModel
from terrain_estimator.palpaca import PAlpaca
from terramechanics.rover import Rover
from terramechanics.soil import Soil

_NO_EFFECT = 1e12
"""Precision of a net weight that leaves it at zero."""


def restore(loaded: LoadedModel) -> PAlpaca:
    """The same model with the same numbers as a Python module."""
    values = loaded.module.state_dict()
    last = values["net.layers.4.weight"]
    model = build_model(loaded.rover, loaded.metadata.soil, last.shape[0] // (len(loaded.rover.axle_x) + 2), last.shape[1])
    model.load_state_dict(values)
    return _frozen(model)


def physics_alone(rover: Rover, soil: Soil) -> PAlpaca:
    """The model without learnt features: one column, whose weight is held at zero."""
    model = build_model(rover, soil, columns=1, hidden=1)
    model.net_precision.fill_(_NO_EFFECT)
    return _frozen(model)


def _frozen(model: PAlpaca) -> PAlpaca:
    for parameter in model.parameters():
        parameter.requires_grad = False
    return model
