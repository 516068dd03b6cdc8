# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soils and rovers that come with the package, found by name: presets/<kind>/<name>.yaml."""

from pathlib import Path

from rover_parameters.records import ConfigError

PRESETS = Path(__file__).parent
"""Folder with a folder of YAML files for each kind, soils and rovers."""


def preset_path(kind: str, name: str | Path) -> Path:
    """Return the file of the preset ``name``, or ``name`` where it is the path of a YAML file.

    Raises ConfigError that lists the presets of this kind (soils, rovers).
    """
    preset = PRESETS / kind / f"{name}.yaml"
    if preset.is_file():
        return preset
    path = Path(name).expanduser()
    if path.suffix in (".yaml", ".yml") and path.is_file():
        return path
    known = ", ".join(preset_names(kind))
    raise ConfigError(
        f"{name}: neither one of the {kind} that come with the package ({known}) nor a readable"
        " .yaml file"
    )


def preset_names(kind: str) -> tuple[str, ...]:
    """Return the names of the presets of one kind, sorted."""
    return tuple(sorted(path.stem for path in (PRESETS / kind).glob("*.yaml")))
