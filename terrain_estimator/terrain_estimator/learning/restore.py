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
    Raises ModelFileError where it has named effects, or no net to trust.
    """
    if loaded.effects:
        raise ModelFileError(
            f"model {loaded.model_id} has named effects: give the model that it was made from"
        )
    if loaded.metadata.wheels:
        raise ModelFileError(f"model {loaded.model_id} is by wheel: give one that is by axle")
    if trust is not None and not has_net(loaded):
        raise ModelFileError(f"model {loaded.model_id} has no net: give one that has")
    values = loaded.module.state_dict()
    prior, columns, hidden, moments = loaded.metadata.prior, 0, 1, True
    if has_net(loaded):
        last = values["net.layers.4.weight"]
        rows = values["net.row_scale"].shape[0]
        columns, moments = last.shape[0] // rows, rows > len(loaded.rover.axle_x) + 2
        hidden = last.shape[1]
    model = build_model(
        loaded.rover, loaded.metadata.soils, columns, hidden, prior, moments=moments
    )
    # The rover file has them; models of older versions store the pivot in another form.
    own = model.state_dict()
    values |= {name: own[name] for name in own if name.rpartition(".")[2] in GEOMETRY}
    model.load_state_dict(values)
    if trust is not None:
        shares = torch.tensor([1.0 - trust, trust], dtype=torch.float64)
        model.hypotheses.net_log_weight.copy_(shares.log())
    return _frozen(model)


def has_net(loaded: LoadedModel) -> bool:
    """Return whether a model has learnt features beside its physics."""
    return "net_0" in loaded.metadata.parameters


def physics_alone(rover: Rover, soil: Soil, *, exact: bool) -> PAlpaca:
    """Return the model without learnt features.

    ``exact`` makes the soil constants exact; else they are parameters with the prior of the
    trained models.
    """
    prior = dataclasses.replace(DEFAULT_PRIOR, constants_sd=0.0) if exact else DEFAULT_PRIOR
    return _frozen(build_model(rover, [soil], prior=prior))


def _frozen(model: PAlpaca) -> PAlpaca:
    for parameter in model.parameters():
        parameter.requires_grad = False
    return model
