# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a program: a tree of frozen dataclasses whose leaves have flat public names.

The fields are those of :mod:`rover_parameters.records`, each with a default. From this one
definition come the declaration to ROS, ``--help``, ``--dump-config`` and the page of parameters. A
group's name is a prefix (``change.soil``), except for an ``INLINE`` group, which only orders the
code.
"""

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, TypeVar, cast, get_type_hints

import yaml

from rover_parameters.records import ConfigError, convert, nearest

Value = bool | int | float | str
RecordT = TypeVar("RecordT")
INLINE = {"inline": True}
"""Metadata of a dataclass field: the names of this group's parameters have no prefix."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter that a user may set."""

    name: str
    default: Value
    description: str
    unit: str  # "" where the value has none
    low: float  # inclusive unless ``exclusive``, -inf where there is none
    high: float
    exclusive: bool

    @property
    def limits(self) -> str:
        """The range in words, empty where there is none."""
        if math.isinf(self.low):
            return ""
        if math.isinf(self.high):
            return f"{'above' if self.exclusive else 'at least'} {self.low:g}"
        return (
            f"above {self.low:g}, at most {self.high:g}"
            if self.exclusive
            else f"{self.low:g} to {self.high:g}"
        )

    @property
    def range(self) -> tuple[float, float] | None:
        """Both ends of the range as ROS needs them.

        None where one is missing, or where the default is NaN, "not given".
        """
        if math.isinf(self.low) or math.isinf(self.high) or self.default != self.default:
            return None
        return self.low, self.high

    @property
    def meaning(self) -> str:
        """Description and unit."""
        return f"{self.description} [{self.unit}]" if self.unit else self.description

    @property
    def shown_default(self) -> str:
        """The default in short."""
        if isinstance(self.default, bool):
            return str(self.default).lower()
        return f"{self.default:g}" if isinstance(self.default, float) else str(self.default)


def parameters(record: type[Any]) -> Iterator[Parameter]:
    """Yield all parameters of a configuration class, depth first, in the order of definition."""
    for name, _, item in _leaves(record, ""):
        metadata, unit = item.metadata, item.metadata.get("unit", "1")
        low, high = metadata.get("low", -math.inf), metadata.get("high", math.inf)
        yield Parameter(
            name,
            item.default,
            metadata["description"],
            "" if unit == "1" else unit,
            low,
            high,
            metadata.get("exclusive", False),
        )


def configure(record: type[RecordT], values: Mapping[str, Any]) -> RecordT:
    """Build a configuration from flat or nested values, and defaults for the others.

    Raises ConfigError that names the parameter for an unknown name, a wrong type or a value out of
    range.
    """
    flat = flatten(values)
    leaves = {name: (hint, item) for name, hint, item in _leaves(record, "")}
    for name in flat:
        if name not in leaves:
            raise ConfigError(f"unknown parameter {name}: {nearest(name, leaves)}")
    converted = {
        name: _converted(*leaves[name], value, f"parameter {name}") for name, value in flat.items()
    }
    return _made(record, converted, "")


def check(record: type[Any], name: str, value: object) -> None:
    """Check one value by itself, without those that it must fit.

    Raises ConfigError that names the parameter for a wrong type or a value out of range.
    """
    hint, item = next((hint, item) for leaf, hint, item in _leaves(record, "") if leaf == name)
    _converted(hint, item, value, f"parameter {name}")


def effective(config: object) -> dict[str, Value]:
    """Return the values in force, by flat name."""
    names = [name for name, _, _ in _leaves(type(config), "")]
    return dict(zip(names, _values(config), strict=True))


def fingerprint(values: Mapping[str, Value]) -> str:
    """Return the sha256 of a flat configuration in hexadecimal; the order of keys is irrelevant."""
    return hashlib.sha256(json.dumps(dict(values), sort_keys=True).encode()).hexdigest()


def flatten(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten nested mappings to one with dotted names, as ROS flattens parameter files."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        flat |= (
            flatten(value, f"{prefix}{key}.")
            if isinstance(value, Mapping)
            else {f"{prefix}{key}": value}
        )
    return flat


def usage(program: str, example: str, record: type[Any]) -> str:
    """Return the text of ``--help``: every parameter with default, range and unit."""
    options = "[-p NAME:=VALUE] [-r FROM:=TO] [--params-file FILE] ..."
    lines = [f"usage: {program} [--help] [--dump-config] [--ros-args {options}]"]
    lines += [
        (
            f"for instance --ros-args -p {example}; --dump-config prints the parameters in force as"
            " a parameter file"
        ),
        "",
    ]
    for each in parameters(record):
        default = f"'{each.default}'" if isinstance(each.default, str) else each.shown_default
        limits = f", {each.limits}" if each.limits else ""
        lines += [
            f"  {each.name} (default {default}{limits}{f' {each.unit}' if each.unit else ''})",
            f"      {each.description}",
        ]
    return "\n".join(lines)


def template(node: str, config: object, advice: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return a parameter file with all values in force.

    Comments give meaning, unit, range and default of each, and the ``advice`` for its name.
    """
    values = effective(config)
    lines = [f"{node}:", "  ros__parameters:"]
    for each in parameters(type(config)):
        shown = yaml.safe_dump({each.name: values[each.name]}, width=math.inf).strip()
        remarks = [each.meaning, each.limits, f"default {each.shown_default or 'empty'}"]
        hints = [f"    # Change it {advice[each.name]}."] if each.name in advice else []
        lines += [f"    # {'; '.join(filter(None, remarks))}", *hints, f"    {shown}"]
    return "\n".join(lines)


def table(record: type[Any]) -> str:
    """Return the parameters as a table of Markdown."""
    lines = ["| parameter | default | unit | range | meaning |", "|---|---|---|---|---|"]
    for each in parameters(record):
        default = f"`{each.shown_default}`" if each.shown_default else ""
        lines.append(
            f"| `{each.name}` | {default} | {each.unit} | {each.limits} | {each.description} |"
        )
    return "\n".join(lines)


def _leaves(record: type[Any], prefix: str) -> Iterator[tuple[str, Any, Any]]:
    """Yield name, type and dataclass field of every parameter."""
    hints = get_type_hints(record)
    for item in dataclasses.fields(record):
        if dataclasses.is_dataclass(hints[item.name]):
            yield from _leaves(hints[item.name], _inside(prefix, item))
        else:
            yield f"{prefix}{item.metadata.get('key') or item.name}", hints[item.name], item


def _inside(prefix: str, item: Any) -> str:
    return prefix if item.metadata.get("inline") else f"{prefix}{item.name}."


def _values(config: object) -> Iterator[Value]:
    for item in dataclasses.fields(cast("Any", config)):
        value = getattr(config, item.name)
        if dataclasses.is_dataclass(value):
            yield from _values(value)
        else:
            yield value


def _converted(hint: Any, item: Any, value: object, where: str) -> Value:
    """Convert a value; NaN is accepted where it is the default, "not given"."""
    if (
        isinstance(value, float)
        and math.isnan(value)
        and isinstance(item.default, float)
        and math.isnan(item.default)
    ):
        return value
    converted: Value = convert(hint, value, item, where)
    return converted


def _made(record: type[Any], flat: Mapping[str, Value], prefix: str) -> Any:
    hints = get_type_hints(record)
    fields: dict[str, Any] = {}
    for item in dataclasses.fields(record):
        name = f"{prefix}{item.metadata.get('key') or item.name}"
        if dataclasses.is_dataclass(hints[item.name]):
            fields[item.name] = _made(cast("Any", hints[item.name]), flat, _inside(prefix, item))
        elif name in flat:
            fields[item.name] = flat[name]
    return record(**fields)
