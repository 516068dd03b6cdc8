# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The Python model behind a model file, for torch.vmap and masked rows, which TorchScript lacks."""

import dataclasses

import torch

from terrain_estimator.learning.training import build_model
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import ModelFileError
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics import GEOMETRY
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover


def restore(loaded: LoadedModel, *, trust: float | None = None) -> PAlpaca:
    """Return a loaded model as a Python module with the same numbers.

    ``trust`` replaces the prior probability [1] of the hypotheses with the net.
    Raises ModelFileError where it has named effects.
    """
    if loaded.effects:
        raise ModelFileError(
            f"model {loaded.model_id} has named effects: give the model that it was made from"
        )
    if loaded.metadata.wheels:
        raise ModelFileError(f"model {loaded.model_id} is by wheel: give one that is by axle")
    values = loaded.module.state_dict()
    last = values["net.layers.4.weight"]
    prior = loaded.metadata.prior
    rows = values["net.row_scale"].shape[0]
    columns, moments = last.shape[0] // rows, rows > len(loaded.rover.axle_x) + 2
    model = build_model(
        loaded.rover, loaded.metadata.soils, columns, last.shape[1], prior, moments=moments
    )
    # The rover file has them; models of older versions store the pivot in another form.
    own = model.state_dict()
    values |= {name: own[name] for name in own if name.rpartition(".")[2] in GEOMETRY}
    model.load_state_dict(values)
    if trust is not None:
        _trust(model, trust)
    return _frozen(model)


def physics_alone(rover: Rover, soil: Soil, *, exact: bool) -> PAlpaca:
    """Return the model without learnt features: one column, of prior probability zero.

    ``exact`` makes the soil constants exact; else they are parameters with the prior of the
    trained models.
    """
    prior = dataclasses.replace(DEFAULT_PRIOR, constants_sd=0.0) if exact else DEFAULT_PRIOR
    model = build_model(rover, [soil], columns=1, hidden=1, prior=prior)
    _trust(model, 0.0)
    return _frozen(model)


def _trust(model: PAlpaca, probability: float) -> None:
    model.hypotheses.net_log_weight.copy_(
        torch.tensor([1.0 - probability, probability], dtype=torch.float64).log()
    )


def _frozen(model: PAlpaca) -> PAlpaca:
    for parameter in model.parameters():
        parameter.requires_grad = False
    return model
