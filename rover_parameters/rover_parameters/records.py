# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Read configuration files strictly: YAML into frozen dataclasses.

An unknown key is an error that names it and the nearest right one, at every level; so are a missing
key, a duplicate key, a wrong type and a value outside its range. An int is accepted for a float. A
range is declared once, on the dataclass field, with :func:`number`.
"""

import dataclasses
import difflib
import itertools
import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import yaml

LARGEST_TREE = 100_000
"""Largest number of values in a YAML file."""
RecordT = TypeVar("RecordT")


class ConfigError(ValueError):
    """A wrong configuration; the message has file, key, value and what is expected."""


def number(
    description: str,
    unit: str = "1",
    low: float = -math.inf,
    high: float = math.inf,
    *,
    exclusive: bool = False,
    default: Any = dataclasses.MISSING,
    key: str = "",
) -> Any:
    """Return a dataclass field of a number, or a tuple of them, with meaning, unit and range.

    ``exclusive`` takes the lower end out of the range: ``low=0, exclusive=True`` means positive.
    ``key`` is its public name as a parameter (:mod:`rover_parameters.parameters`) where that is not
    the field's.
    """
    metadata = {
        "description": description,
        "unit": unit,
        "low": low,
        "high": high,
        "exclusive": exclusive,
        "key": key,
    }
    if default is dataclasses.MISSING:
        return dataclasses.field(metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def entry(
    description: str, default: Any = dataclasses.MISSING, *, key: str = "", empty: bool = False
) -> Any:
    """Return a dataclass field of anything but a number, with its meaning.

    ``key`` is as for a number. A text may be empty where its default is, or with ``empty``.
    """
    metadata = {"description": description, "key": key, "empty": empty}
    if default is dataclasses.MISSING:
        return dataclasses.field(metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def load(record: type[RecordT], path: Path) -> RecordT:
    """Read the YAML file at ``path`` into the dataclass ``record``. Raises ConfigError."""
    return build(record, read_yaml(path), str(path))


def read_yaml(path: Path) -> object:
    """Read the content of a YAML file. Raises ConfigError."""
    try:
        return parse_yaml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (ConfigError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid YAML: {error}") from error


def parse_yaml(text: str) -> object:
    """Parse a YAML text. Raises ConfigError."""
    try:
        return yaml.load(text, Loader=_StrictLoader)  # noqa: S506 (a SafeLoader)
    except yaml.YAMLError as error:
        raise ConfigError(str(error)) from error
    # ValueError at a 13th month, KeyError at !!bool x, RecursionError at depth
    except Exception as error:
        raise ConfigError(f"{type(error).__name__}: {error}") from error


def nearest(name: object, known: Iterable[str]) -> str:
    """Return a hint about an unknown name: the nearest known one, or all."""
    names = list(known)
    near = difflib.get_close_matches(str(name), names, n=1)
    return f"did you mean {near[0]}?" if near else f"known are {', '.join(names)}"


def build(record: type[RecordT], content: object, where: str) -> RecordT:
    """Build the dataclass ``record`` from a mapping, strictly. Raises ConfigError."""
    if not isinstance(content, Mapping):
        raise ConfigError(f"{where}: expected a mapping of keys to values, got {_shown(content)}")
    fields = {item.name: item for item in dataclasses.fields(record)}  # type: ignore[arg-type]
    for key in content:
        if key not in fields:
            raise ConfigError(f"{where}: unknown key {key!r}: {nearest(key, fields)}")
    needed = [
        name
        for name, item in fields.items()
        if item.default is item.default_factory is dataclasses.MISSING
    ]
    missing = [name for name in needed if name not in content]
    if missing:
        raise ConfigError(f"{where}: missing key {missing[0]!r}")
    hints = get_type_hints(record)
    values = {
        key: convert(hints[key], value, fields[key], f"{where}: {key}")
        for key, value in content.items()
    }
    try:
        return record(**values)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error


def convert(hint: Any, value: object, field: Any, where: str) -> Any:
    """Convert ``value`` to the type ``hint`` of a dataclass field, and check its range.

    Raises ConfigError that begins with ``where``.
    """
    if get_origin(hint) is tuple:
        return _convert_sequence(get_args(hint), value, field, where)
    if dataclasses.is_dataclass(hint):
        return build(hint, value, where)  # type: ignore[arg-type]
    if hint is str:
        return _text(value, where, empty=field.default == "" or field.metadata.get("empty", False))
    if hint is bool:
        return _boolean(value, where)
    converted = _integer(value, where) if hint is int else _real(value, where)
    _check_range(converted, field.metadata, where)
    return converted


def _convert_sequence(
    kinds: tuple[Any, ...], value: object, field: Any, where: str
) -> tuple[Any, ...]:
    if not isinstance(value, Iterable) or isinstance(value, str | bytes | Mapping):
        raise ConfigError(f"{where}: expected a list, got {_shown(value)}")
    items = list(value)
    wanted = len(items) if kinds[-1] is Ellipsis else len(kinds)
    if len(items) != wanted or not (items or field.default == ()):
        raise ConfigError(
            f"{where}: expected a list of {wanted or 'at least 1'} values, got {len(items)}"
        )
    return tuple(
        convert(kinds[0], item, field, f"{where}[{index}]") for index, item in enumerate(items)
    )


def _text(value: object, where: str, *, empty: bool) -> str:
    if not isinstance(value, str) or not (value or empty):
        raise ConfigError(f"{where}: expected a text, got {_shown(value)}")
    return value


def _boolean(value: object, where: str) -> bool:
    if not isinstance(value, bool):
        raise ConfigError(f"{where}: expected true or false, got {_shown(value)}")
    return value


def _integer(value: object, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise ConfigError(f"{where}: expected a whole number, got {_shown(value)}")
    return value


def _real(value: object, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{where}: expected a number, got {_shown(value)}")
    try:
        return float(value)
    except OverflowError as error:
        raise ConfigError(
            f"{where}: a whole number of more than 300 digits, too large to calculate with"
        ) from error


def _check_range(value: float, limits: Mapping[str, Any], where: str) -> None:
    low, high = limits.get("low", -math.inf), limits.get("high", math.inf)
    below = value <= low if limits.get("exclusive", False) else value < low
    if not math.isfinite(value) or below or value > high:
        unit = limits.get("unit", "1")
        bound = "above" if limits.get("exclusive", False) else "at least"
        upper = f" and at most {high:g}" if high < math.inf else ""
        raise ConfigError(
            f"{where}: {value:g} is outside its range: a finite number {bound} {low:g}{upper}"
            f" [{unit}] is expected"
        )


def _shown(value: object) -> str:
    return f"{value!r} ({type(value).__name__})"


def _written_out(node: yaml.Node, known: dict[int, int]) -> int:
    """Count the values of a tree with its aliases expanded.

    Nine lines can expand to 10^9 values; an alias that contains itself expands without end.
    """
    if id(node) not in known:
        known[id(node)] = LARGEST_TREE + 1  # for an alias within itself
        children = (
            itertools.chain(*node.value) if isinstance(node, yaml.MappingNode) else node.value
        )
        known[id(node)] = 1 + (
            0
            if isinstance(node, yaml.ScalarNode)
            else sum(_written_out(child, known) for child in children)
        )
    return known[id(node)]


class _StrictLoader(yaml.SafeLoader):
    """SafeLoader that refuses duplicate keys and endless aliases.

    It reads 1e6 as a number, as YAML 1.2 does; YAML 1.1 reads it as a text.
    """

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None and _written_out(node, {}) > LARGEST_TREE:
            raise yaml.constructor.ConstructorError(
                None,
                None,
                f"more than {LARGEST_TREE} values when its aliases are written out",
                None,
            )
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:  # noqa: FBT001, FBT002
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key!r} is given twice", node.start_mark
                )
        return super().construct_mapping(node, deep)


_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)
