# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What describes a model: the JSON file beside its module, and where both lie.

``NAME.pt`` holds the whole model; ``NAME.json`` holds rover, soil, rows, versions, how it was
trained, and the size and sha256 of the module.
"""

import dataclasses
import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import terrain_estimator
from rover_parameters.guarded_json import parse_json
from rover_parameters.records import ConfigError, build, number, shortened
from rover_parameters.regular_file import open_regular, read_regular
from terrain_estimator.model.prior import Prior
from terramechanics.terrain.soil import WONG_REECE, Soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces

FORMAT = 4
"""Version of the interface: the state's fields, the packed observation, the methods."""
TORQUE_GAIN = "torque_gain"
"""[1] Name of the parameter of a model that does not know the gain of its torques."""

VELOCITY_ALONE = ("velocity",)
"""The rows of a model for data whose sinkages follow from no balance."""

MODELS = Path(terrain_estimator.__file__).parent / "models"
DEFAULT_MODEL = "mars_rover"
_LARGEST_FILE = 64 << 20
_LARGEST_METADATA = 1 << 20


class ModelFileError(ValueError):
    """A model file is missing, damaged, foreign or of another version.

    The message names the file, the fault, and the remedy.
    """


@dataclass(frozen=True, slots=True)
class Training:
    """The training of the learnt part."""

    seed: int
    iterations: int
    loss: float = number(
        "final training loss: mean negative log predictive density of a row", "nat"
    )
    torch_version: str = ""
    options: tuple[
        str, ...
    ] = ()  # effective ones of ``train``, in its own words; a file that is older has none


@dataclass(frozen=True, slots=True)
class AddedEffect:
    """A named effect that the model estimates beside c and tan phi."""

    name: str  # of terramechanics.effects
    unit: str  # of its size
    mean: float = number("prior mean of its size", "unit of the effect")
    sd: float = number(
        "prior standard deviation of its size", "unit of the effect", 0.0, exclusive=True
    )


@dataclass(frozen=True, slots=True)
class Metadata:
    """The content of the JSON file beside the module."""

    format: int
    model_id: str
    sha256: str
    size: int
    observation_axle_fields: tuple[str, ...]
    observation_scalar_fields: tuple[str, ...]
    rows: tuple[str, ...]
    parameters: tuple[str, ...]  # of the posterior, in their order
    block: int  # observations that are averaged into one
    rover: Rover
    soils: tuple[
        Soil, ...
    ]  # that the model knows; their order is that of the state's probabilities
    training: Training
    prior: Prior  # of ground and rover, before any measurement
    step_s: float = number(
        "time between observations that the model was trained for", "s", 0.0, exclusive=True
    )
    effects: tuple[AddedEffect, ...] = ()
    wheel_places: WheelPlaces | None = None  # of a model by wheel; None: it is by axle
    used_rows: tuple[str, ...] = ()  # the only rows that count; none named: all

    def __post_init__(self) -> None:
        if self.wheel_places is not None:
            self.wheel_places.check(self.rover)
        if self.used_rows not in ((), VELOCITY_ALONE):
            raise ConfigError(
                f"used_rows {shortened(', '.join(self.used_rows))}: give"
                f" {', '.join(VELOCITY_ALONE)}, or leave it out for all rows"
            )

    @property
    def stations(self) -> int:
        """Number of values of a quantity in an observation: one per axle, or per wheel."""
        return self.rover.axles if self.wheel_places is None else len(self.rover.wheels)

    @property
    def wheels(self) -> tuple[str, ...]:
        """Names of the wheels of a model by wheel, front to rear, left before right; else none."""
        return () if self.wheel_places is None else self.wheel_places.wheels(self.rover)

    @property
    def steered(self) -> tuple[bool, ...]:
        """Whether a joint turns each of the ``wheels``."""
        return () if self.wheel_places is None else self.wheel_places.steers(self.rover)

    @property
    def prior_mean(self) -> tuple[float, float]:
        """Prior means of c [Pa] and tan phi."""
        return self.prior.cohesion_pa, self.prior.tan_phi

    @property
    def prior_sd(self) -> tuple[float, float]:
        """Prior standard deviations of c [Pa] and tan phi."""
        return self.prior.cohesion_sd_pa, self.prior.tan_phi_sd

    @property
    def velocity_alone(self) -> bool:
        """Whether the velocity row alone counts: no balance of loads, torques or moments."""
        return self.used_rows == VELOCITY_ALONE

    def refuse_velocity_alone(self, why: str) -> None:
        """Raise ModelFileError that says ``why`` where the velocity row alone counts."""
        if self.velocity_alone:
            raise ModelFileError(
                f"model {self.model_id} uses the velocity row alone (train --rows velocity): {why}"
            )

    @property
    def balances_sinkage(self) -> bool:
        """Whether the model can take sinkages that no sensor measures from the balances.

        These have to determine the loads: else sinkages would have to be guessed, over bumps badly.
        """
        if self.velocity_alone:
            return False
        known = TORQUE_GAIN not in self.parameters and self.rover.is_determined
        return known and not self.effects and all(soil.law == WONG_REECE for soil in self.soils)


def model_names() -> tuple[str, ...]:
    """Return the names of the models that come with the package."""
    return tuple(sorted(path.stem for path in MODELS.glob("*.pt")))


def model_path(name: str) -> Path:
    """Return the module file of an installed model's name, of a path, or of '' for the default."""
    installed = MODELS / f"{name or DEFAULT_MODEL}.pt"
    path = installed if installed.is_file() else Path(name)
    if not path.is_file():
        names = ", ".join(model_names()) or "there is none"
        raise ModelFileError(
            f"model {name!r}: no such file; give the path of a .pt file, or an installed model:"
            f" {names}"
        )
    return path


def read_metadata(path: Path) -> Metadata:
    """Read the JSON file beside a module. Raises ModelFileError that names file, key and value."""
    try:
        content: Any = parse_json(read_regular(path, _LARGEST_METADATA))
    except OSError as error:
        raise ModelFileError(
            f"{path}: cannot be read ({error.strerror}): a model is a .pt file with its .json"
            " beside it"
        ) from error
    except ConfigError as error:
        raise ModelFileError(f"{path}: not valid JSON: {error}") from error
    found = content.get("format") if isinstance(content, dict) else None
    if found != FORMAT:
        raise ModelFileError(
            f"{path}: format is {shortened(found)}, this version reads {FORMAT}: train the model"
            " again (make train)"
        )
    try:
        return build(Metadata, content, str(path))
    except ConfigError as error:
        raise ModelFileError(str(error)) from error


def write_metadata(path: Path, metadata: Metadata) -> None:
    """Write the JSON file beside a module."""
    content = dataclasses.asdict(metadata) | {"rover": metadata.rover.content()}
    for soil in content["soils"]:
        if soil["law"] == WONG_REECE:  # what a file of an older version means, too
            del soil["law"]
    if content["wheel_places"] is None:
        del content["wheel_places"]
    if not content["used_rows"]:
        del content["used_rows"]
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def fingerprint(path: Path) -> tuple[str, int]:
    """Return sha256 and size of a file."""
    content = path.read_bytes()
    return hashlib.sha256(content).hexdigest(), len(content)


def checked_bytes(path: Path, metadata: Metadata) -> bytes:
    """Return the content of a module's file, whose size and sha256 are those of its description.

    It is read once, so that the checked bytes are loaded even where the file is replaced meanwhile.

    Raises:
        ModelFileError: they are not.
    """
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            content = file.read(metadata.size + 1) if metadata.size <= _LARGEST_FILE else b""
    except OSError as error:
        raise ModelFileError(f"{path}: cannot be read: {error.strerror}") from error
    if len(content) != metadata.size:
        raise ModelFileError(
            f"{path}: has {size} bytes, {path.with_suffix('.json').name} says {metadata.size}, at"
            f" most {_LARGEST_FILE} are read: copy both files again"
        )
    sha256 = hashlib.sha256(content).hexdigest()
    if sha256 != metadata.sha256:
        raise ModelFileError(
            f"{path}: sha256 is {sha256}, {path.with_suffix('.json').name} says {metadata.sha256}:"
            " the file is damaged"
        )
    return content
