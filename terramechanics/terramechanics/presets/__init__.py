# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soils and rovers by name, presets/<kind>/<name>.yaml, and from files of a user."""

import re
from dataclasses import replace
from pathlib import Path

from rover_parameters.records import ConfigError
from rover_parameters.yaml_files import load
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

PRESETS = Path(__file__).parent
"""Folder with a folder of YAML files for each kind, soils and rovers."""
_RENAMED = re.compile(r"(?P<rover>[^\[\]]+)\[(?P<wheels>[^\[\]]*)\]")


def load_rover(name: str | Path) -> Rover:
    """Load a preset by its name, or a rover from a YAML file. Raises ConfigError.

    Names in brackets replace those of its wheels, in their order: four_wheel_rover[fl,fr,rl,rr].
    """
    found = _RENAMED.fullmatch(str(name))
    if not found or Path(name).is_file():
        return load(Rover, _path("rovers", name))
    rover = load(Rover, _path("rovers", found["rover"]))
    given = [each.strip() for each in found["wheels"].split(",")]
    if len(given) != len(rover.wheels) or not all(given):
        raise ConfigError(
            f"{name}: {len(given)} names in the brackets, but {rover.name} has the wheels"
            f" {', '.join(rover.wheel_names)}: name each, in this order"
        )
    wheels = zip(rover.wheels, given, strict=True)
    return replace(rover, wheels=tuple(replace(wheel, name=new) for wheel, new in wheels))


def load_soil(name: str | Path) -> Soil:
    """Load a preset by its name, or a soil from a YAML file. Raises ConfigError."""
    return load(Soil, _path("soils", name))


def rover_names() -> tuple[str, ...]:
    """Return the names of the rovers that come with the package."""
    return _names("rovers")


def soil_names() -> tuple[str, ...]:
    """Return the names of the soils that come with the package."""
    return _names("soils")


def _path(kind: str, name: str | Path) -> Path:
    """Return the file of the preset ``name``, or ``name`` where it is the path of a YAML file.

    Raises ConfigError that lists the presets of this kind (soils, rovers).
    """
    preset = PRESETS / kind / f"{name}.yaml"
    if preset.is_file():
        return preset
    path = Path(name).expanduser()
    if path.suffix in (".yaml", ".yml") and path.is_file():
        return path
    known = ", ".join(_names(kind))
    raise ConfigError(
        f"{name}: neither one of the {kind} that come with the package ({known}) nor a readable"
        " .yaml file"
    )


def _names(kind: str) -> tuple[str, ...]:
    """Return the names of the presets of one kind, sorted."""
    return tuple(sorted(path.stem for path in (PRESETS / kind).glob("*.yaml")))
