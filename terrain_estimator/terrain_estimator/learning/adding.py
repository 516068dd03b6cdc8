# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Add named effects to a model, whose sizes it then estimates beside c and tan phi; no training."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from rover_parameters.records import ConfigError
from terrain_estimator.discovery.hypotheses.library import Hypothesis, LibraryEffect
from terrain_estimator.learning.by_wheel import BODY_PARAMETERS, build_model_by_wheel
from terrain_estimator.learning.export import save
from terrain_estimator.learning.restore import restore
from terrain_estimator.learning.training import law_of
from terrain_estimator.model.effect_rows import EffectRows
from terrain_estimator.model.effect_values import ValuePrior
from terrain_estimator.model.effects import LAWS, laws_apart, not_estimated
from terrain_estimator.model.effects_by_wheel import EffectsByWheel
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import AddedEffect, Metadata, ModelFileError
from terrain_estimator.model.packed_observation import scalar_fields
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_by_law import ScmStresses
from terrain_estimator.model.physics_of_wheels import physics_by_wheel
from terrain_estimator.model.physics_with_effects import PhysicsWithEffects, nominal_of
from terrain_estimator.model.wheels_with_effects import WheelsWithEffects
from terramechanics.effects import describe
from terramechanics.effects.law import Law
from terramechanics.terrain.soil import LINEAR_STRESS, SCM, WONG_REECE
from terramechanics.vehicle.wheel_places import WheelPlaces


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

    def checked(self, *, by_wheel: bool = False) -> "Sized":
        """Return this effect, of a model by axle or by wheel.

        Raises ConfigError where it cannot be estimated online, or where a number is wrong.
        """
        described = describe(self.name)
        refused = not_estimated(by_wheel=by_wheel)
        if self.name in refused:
            kind = "a model by wheel" if by_wheel else "a model"
            raise ConfigError(f"effect {self.name} cannot be added to {kind}: {refused[self.name]}")
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
    by_wheel = loaded.metadata.wheel_places is not None
    names = [effect.checked(by_wheel=by_wheel).name for effect in effects]
    if not names or len(set(names)) != len(names):
        raise ConfigError(
            f"effects {', '.join(names) or '(none)'}: at least one is needed, and each once"
        )
    if loaded.metadata.prior.ground_variation:
        raise ConfigError(
            f"model {loaded.model_id} is for ground that varies (made with --ground-variation);"
            " named effects need one of even ground: give that"
        )
    if loaded.metadata.wheel_places is not None:
        return _by_wheel(loaded, loaded.metadata.wheel_places, effects)
    loaded.metadata.refuse_velocity_alone(
        "the velocity alone does not tell a named effect from the ground: give the model of all"
        " rows, made without --rows"
    )
    if law_of(loaded.metadata.soils) == LINEAR_STRESS:
        raise ConfigError(
            f"model {loaded.model_id} has soils of law {LINEAR_STRESS}: named effects are known for"
            f" {WONG_REECE} and {SCM} alone"
        )
    plain, rover = restored(loaded), loaded.rover
    law = ScmStresses() if law_of(loaded.metadata.soils) == SCM else None
    rows = EffectRows([LAWS[name](rover) for name in names], rover.mass, law)
    prior = value_prior(effects, laws_apart(None))
    physics = PhysicsWithEffects(nominal_of(plain.physics), rows, prior)
    model = PAlpaca(physics, plain.net, plain.prior)
    model.hypotheses.load_state_dict(plain.hypotheses.state_dict())
    return model


def _by_wheel(loaded: LoadedModel, places: WheelPlaces, effects: Sequence[Sized]) -> PAlpaca:
    """Return what :func:`with_effects` does of a model by wheel, which no training made."""
    known, rover = loaded.metadata, loaded.rover
    if loaded.effects:
        raise ModelFileError(
            f"model {loaded.model_id} has named effects: give the model that it was made from"
        )
    if set(known.parameters) & set(BODY_PARAMETERS[2:]):
        raise ConfigError(
            f"model {loaded.model_id} does not know the gain of its torques, which named effects"
            " need: give a model by wheel without --torque-gain-sd"
        )
    plain = build_model_by_wheel(rover, places, known.soils, known.prior)
    apart = laws_apart(places)
    laws = [apart.get(each.name, describe(each.name).law)(rover) for each in effects]
    acting = EffectsByWheel(laws, rover)
    constants = torch.stack([soil.constants() for soil in known.soils])
    by_wheel = physics_by_wheel(rover, places, constants, known.prior.constants_sd, acting)
    model = PAlpaca(
        WheelsWithEffects(by_wheel, acting, value_prior(effects, apart)),
        plain.net,
        plain.prior,
    )
    model.hypotheses.load_state_dict(plain.hypotheses.state_dict())
    return model


def value_prior(effects: Sequence[Sized], apart: Mapping[str, type[Law]]) -> ValuePrior:
    """Return the prior of the effects' values: of each its size, then its further values.

    Those of laws that stand ``apart`` go with the size.
    """
    named = [LibraryEffect(effect.name) for effect in effects]
    library = Hypothesis(tuple(named)).shared()
    mean, sd, place = torch.zeros_like(library.sd), library.sd.clone(), 0
    low, high = library.low.clone(), library.high.clone()
    for each, effect in zip(named, effects, strict=True):
        mean[place] = each.law.value_of(effect.mean)
        # The value of a size that is a square: where the size is zero give or take a deviation, the
        # root of that deviation.
        root = max(each.law.value_of(effect.mean), each.law.value_of(effect.sd))
        sd[place] = effect.sd / each.law.slope(root)
        if effect.name in apart:
            for number, further in enumerate(apart[effect.name].extra, place + 1):
                sd[number] = further.sd * math.hypot(effect.mean, effect.sd)
                low[number], high[number] = -4.0 * sd[number], 4.0 * sd[number]
        place += each.count
    return ValuePrior(mean, sd, low, high)


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
        observation_scalar_fields=scalar_fields(
            loaded.metadata.stations, rates=True, by_wheel=bool(loaded.metadata.wheels)
        ),
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
