# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Strict configuration: one definition of every parameter, for the ROS declaration, YAML files and the docs.

A configuration is a tree of frozen dataclasses whose leaves are made by :func:`parameter`. Every leaf has one flat
name (``prior.cohesion_mean``), a description, a unit and a range. An unknown key is an error that names it.
"""

import dataclasses
import difflib
import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, cast

Value = bool | int | float | str
Config = TypeVar("Config")


class ParameterError(ValueError):
    """A parameter is unknown, has the wrong type, or lies outside its range."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter: what a user may set."""

    name: str
    default: Value
    description: str
    unit: str  # "" where the value has none
    minimum: float  # inclusive, -inf where there is none
    maximum: float

    @property
    def constraints(self) -> str:
        """The range in words, empty where there is none."""
        if math.isinf(self.minimum) and math.isinf(self.maximum):
            return ""
        return f"{self.minimum:g} to {self.maximum:g}" if math.isfinite(self.maximum) else f"at least {self.minimum:g}"

    def check(self, value: object) -> Value:
        """Return ``value`` in the parameter's type; an int where a float is meant is accepted.

        Raises ParameterError, which names the parameter, the value and what is allowed.
        """
        wanted = type(self.default)
        if wanted is float and type(value) is int:
            value = float(value)
        if type(value) is not wanted:
            raise ParameterError(f"parameter {self.name}: {value!r} is a {type(value).__name__}, give a {wanted.__name__}")
        if isinstance(value, int | float) and not self.minimum <= value <= self.maximum:
            allowed = f"{self.constraints or 'a finite number'} {self.unit}".rstrip()
            raise ParameterError(f"parameter {self.name}: {value!r} is out of range, give {allowed}")
        return value


def parameter(name: str, default: Value, description: str, *, unit: str = "", minimum: float = -math.inf, maximum: float = math.inf) -> Any:  # noqa: ANN401 - stands for the field's own type, as dataclasses.field does
    """A dataclass field that is a parameter. ``name`` is its flat, public name."""
    bounds = {"minimum": minimum, "maximum": maximum}
    return dataclasses.field(default=default, metadata={"parameter": Parameter(name, default, description, unit, **bounds)})


def definitions(config: type[Any]) -> Iterator[Parameter]:
    """All parameters of a configuration class, depth first, in the order of their definition."""
    for entry in dataclasses.fields(config):
        if "parameter" in entry.metadata:
            yield entry.metadata["parameter"]
        else:
            yield from definitions(cast("type[Any]", entry.type))


def flatten(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings as one flat mapping with dotted names, as ROS does it with parameter files."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def build(config: type[Config], values: Mapping[str, Any]) -> Config:
    """Build a configuration from flat or nested values; what is not given keeps its default.

    Raises ParameterError for an unknown key, a wrong type or a value out of range.
    """
    flat = flatten(values)
    known = {entry.name for entry in definitions(config)}
    for key in flat:
        if key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(sorted(known))}"
            raise ParameterError(f"unknown parameter {key}: {hint}")
    return _build(config, flat)


def _build(config: type[Config], flat: Mapping[str, Any]) -> Config:
    fields: dict[str, Any] = {}
    for entry in dataclasses.fields(cast("Any", config)):
        leaf = entry.metadata.get("parameter")
        if leaf is None:
            fields[entry.name] = _build(cast("type[Any]", entry.type), flat)
        elif leaf.name in flat:
            fields[entry.name] = leaf.check(flat[leaf.name])
    return config(**fields)


def effective(config: object) -> dict[str, Value]:
    """The values in force, by flat name."""
    flat: dict[str, Value] = {}
    for entry in dataclasses.fields(cast("Any", config)):
        leaf = entry.metadata.get("parameter")
        value = getattr(config, entry.name)
        if leaf is None:
            flat |= effective(value)
        else:
            flat[leaf.name] = value
    return flat


def fingerprint(values: Mapping[str, Value]) -> str:
    """sha256 of a flat configuration, in hexadecimal; independent of the order of the keys."""
    return hashlib.sha256(json.dumps(dict(values), sort_keys=True).encode()).hexdigest()
