# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Build frozen dataclasses from the content of configuration files, strictly.

An unknown key is an error that names it and the nearest right one, at every level; so are a missing
key, a wrong type and a value outside its range. An int is accepted for a float. A range is declared
once, on the dataclass field, with :func:`number`. :mod:`rover_parameters.yaml_files` reads files.
"""

import dataclasses
import difflib
import itertools
import math
import reprlib
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

SHOWN = 100
"""Largest number of names in an error."""
_COMPARED = 1000  # names from a file among which the nearest is searched
_LONGEST_NAME = 100  # characters of it
_SHORTENED = reprlib.Repr()
_SHORTENED.maxstring = _SHORTENED.maxother = _SHORTENED.maxlong = 80
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


def shortened(value: object) -> str:
    """Return the repr of a value from a file, cut so that an error stays one readable line."""
    return _SHORTENED.repr(value)


def nearest(name: object, known: Iterable[str]) -> str:
    """Return a hint about an unknown name: the nearest known one, or all."""
    names = list(itertools.islice(known, _COMPARED))
    near = difflib.get_close_matches(str(name)[:_LONGEST_NAME], names, n=1)
    return f"did you mean {near[0]}?" if near else f"known are {', '.join(names[:SHOWN])}"


def build(record: type[RecordT], content: object, where: str) -> RecordT:
    """Build the dataclass ``record`` from a mapping, strictly. Raises ConfigError."""
    if not isinstance(content, Mapping):
        raise ConfigError(f"{where}: expected a mapping of keys to values, got {_shown(content)}")
    fields = {item.name: item for item in dataclasses.fields(record)}  # type: ignore[arg-type]
    for key in content:
        if key not in fields:
            raise ConfigError(f"{where}: unknown key {shortened(key)}: {nearest(key, fields)}")
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
    if type(None) in get_args(hint):  # a value that may be left out, not one that may be null
        return convert(get_args(hint)[0], value, field, where)
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
        ends = [f"{bound} {low:g}"] if low > -math.inf else []
        ends += [f"at most {high:g}"] if high < math.inf else []
        wanted = " ".join(["a finite number", *filter(None, [" and ".join(ends)])])
        raise ConfigError(f"{where}: {value:g} is outside its range: {wanted} [{unit}] is expected")


def _shown(value: object) -> str:
    return f"{shortened(value)} ({type(value).__name__})"
