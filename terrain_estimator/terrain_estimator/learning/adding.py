# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Add named effects to a model, whose sizes it then estimates beside c and tan phi; no training."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from rover_parameters.records import ConfigError
from terrain_estimator.discovery.hypotheses.library import Hypothesis, LibraryEffect
from terrain_estimator.learning.export import save
from terrain_estimator.learning.restore import restore
from terrain_estimator.learning.training import law_of
from terrain_estimator.model.effect_rows import EffectRows
from terrain_estimator.model.effects import LAWS, NOT_ONLINE
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import AddedEffect, Metadata, ModelFileError
from terrain_estimator.model.packed_observation import scalar_fields
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_by_law import ScmStresses
from terrain_estimator.model.physics_with_effects import PhysicsWithEffects, ValuePrior, nominal_of
from terramechanics.effects import describe
from terramechanics.terrain.soil import SCM


@dataclass(frozen=True, slots=True)
class Sized:
    """An effect with the prior of its size, in the effect's unit."""

    name: str
    mean: float
    sd: float

    @classmethod
    def of_library(cls, name: str) -> "Sized":
        """Return the library's prior: zero, with half of the physical range as deviation."""
        described = describe(name)
        return cls(name, 0.0, 0.5 * max(abs(described.low), abs(described.high)))

    def checked(self) -> "Sized":
        """Return this effect.

        Raises ConfigError where it cannot be estimated online, or where a number is wrong.
        """
        described = describe(self.name)
        if self.name in NOT_ONLINE:
            raise ConfigError(
                f"effect {self.name} cannot be added to a model: {NOT_ONLINE[self.name]}"
            )
        described.checked(self.mean)
        if not (math.isfinite(self.sd) and self.sd > 0.0):
            raise ConfigError(
                f"effect {self.name}: standard deviation {self.sd:g} {described.unit} is not a"
                " positive number"
            )
        return self


def restored(loaded: LoadedModel, *, trust: float | None = None) -> PAlpaca:
    """Restore a model; raises ModelFileError where another version made the file."""
    try:
        return restore(loaded, trust=trust)
    except RuntimeError as error:  # torch's: tensors are missing or have other shapes
        raise ModelFileError(
            f"model {loaded.model_id} was made by another version, whose tensors are others: the"
            " estimator takes it as it is, but to go on from it train it again (docs/training.md)"
        ) from error


def with_effects(loaded: LoadedModel, effects: Sequence[Sized]) -> PAlpaca:
    """Return the model ``loaded`` with ``effects`` as further parameters.

    Raises ConfigError that names the effect, and the errors of :func:`restored`.
    """
    names = [effect.checked().name for effect in effects]
    if not names or len(set(names)) != len(names):
        raise ConfigError(
            f"effects {', '.join(names) or '(none)'}: at least one is needed, and each once"
        )
    if loaded.metadata.wheels:
        raise ConfigError(
            f"model {loaded.model_id} is by wheel; named effects need one by axle: give that"
        )
    if loaded.metadata.prior.ground_variation:
        raise ConfigError(
            f"model {loaded.model_id} is for ground that varies (--ground-variation of train);"
            " named effects need one of even ground: give that"
        )
    plain, rover = restored(loaded), loaded.rover
    law = ScmStresses() if law_of(loaded.metadata.soils) == SCM else None
    rows = EffectRows([LAWS[name](rover) for name in names], rover.mass, law)
    physics = PhysicsWithEffects(nominal_of(plain.physics), rows, value_prior(effects))
    model = PAlpaca(physics, plain.net, plain.prior)
    model.hypotheses.load_state_dict(plain.hypotheses.state_dict())
    return model


def value_prior(effects: Sequence[Sized]) -> ValuePrior:
    """Return the prior of the effects' values: of each its size, then its further values."""
    named = [LibraryEffect(effect.name) for effect in effects]
    library = Hypothesis(tuple(named)).shared()
    mean, sd, place = torch.zeros_like(library.sd), library.sd.clone(), 0
    for each, effect in zip(named, effects, strict=True):
        mean[place] = each.law.value_of(effect.mean)
        # The value of a size that is a square: where the size is zero give or take a deviation, the
        # root of that deviation.
        root = max(each.law.value_of(effect.mean), each.law.value_of(effect.sd))
        sd[place] = effect.sd / each.law.slope(root)
        place += each.count
    return ValuePrior(mean, sd, library.low, library.high)


def export_with(
    model: PAlpaca, loaded: LoadedModel, effects: Sequence[Sized], path: Path
) -> Metadata:
    """Write ``path`` (.pt) and the .json beside it: the metadata of ``loaded`` with the effects."""
    names = [effect.name for effect in effects]
    values = tuple(
        f"{name}_{k}" if k else name for name in names for k in range(LibraryEffect(name).count)
    )
    fixed = loaded.metadata.parameters[-4:]
    changed = dataclasses.replace(
        loaded.metadata,
        model_id="+".join([loaded.model_id, *names]),
        observation_scalar_fields=scalar_fields(len(loaded.rover.axle_x), rates=True),
        parameters=(*loaded.metadata.parameters[:-4], *values, *fixed),
        effects=tuple(
            AddedEffect(effect.name, describe(effect.name).unit, effect.mean, effect.sd)
            for effect in effects
        ),
    )
    return save(model, changed, path)


def add_effects(loaded: LoadedModel, effects: Sequence[Sized], path: Path) -> Metadata:
    """Write the model with ``effects`` to ``path``; raises ConfigError that names the effect."""
    return export_with(with_effects(loaded, effects), loaded, effects, path)
