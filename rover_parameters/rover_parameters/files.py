# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Read parameter files and assignments in the form of ROS 2, strictly and without ROS.

ROS itself ignores a section that matches no node, such as one with a misspelt name.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from rover_parameters.parameters import configure, flatten
from rover_parameters.records import SHOWN, ConfigError, nearest, shortened
from rover_parameters.yaml_files import parse_yaml, read_yaml

OF_ROS = frozenset({"use_sim_time", "start_type_description_service"})
"""Parameters that every node has."""
OVERRIDES = "qos_overrides."
"""Prefix of the parameters that override the quality of service of a subscription."""

DUMP = "--dump-config"
"""Option of a node: print the parameters in force as a parameter file."""

_SECTION = "ros__parameters"
RecordT = TypeVar("RecordT")


def configured(
    record: type[RecordT], node: str, given: Mapping[str, Any], arguments: Sequence[str]
) -> RecordT:
    """Build the configuration of a node from ROS's parameters and the command line's files.

    ``node`` is a full name. A list of strings is accepted for words separated by spaces.

    Raises:
        ConfigError: unknown name, wrong type, value out of range, or a parameter file that matches
            no node of this name.
    """
    for path in parameter_files(arguments):
        read_parameters(path, node)
    return configure(
        record, {name: _words(value) for name, value in without_those_of_ros(given).items()}
    )


def _words(value: object) -> object:
    return (
        " ".join(value)
        if isinstance(value, list) and all(isinstance(word, str) for word in value)
        else value
    )


def read_parameters(path: Path, node: str) -> dict[str, Any]:
    """Read the parameters, by flat name, that a file has for a node; later sections win.

    ``node`` is a full name such as ``/rover1/estimator``. Parameters of ROS and of quality of
    service are left out: they have no meaning outside of a node.

    Raises:
        ConfigError: the file cannot be read, is no parameter file, or has no section that matches
            the node.
    """
    content = read_yaml(path)
    sections = list(_sections(content, "", path)) if isinstance(content, Mapping) else []
    found = [values for name, values in sections if _matches(name, node)]
    if not found:
        names = [name for name, _ in sections]
        what = (
            f"its sections are {', '.join(names[:SHOWN])}: {nearest(node, names)}"
            if names
            else "it has none at all"
        )
        raise ConfigError(
            f"{path}: no section is for the node {node} ({node.rsplit('/', 1)[-1]}: {{{_SECTION}:"
            f" {{...}}}}); {what}"
        )
    merged: dict[str, Any] = {}
    for values in found:
        merged |= flatten(values)
    return {
        name: value
        for name, value in without_those_of_ros(merged).items()
        if not name.startswith(OVERRIDES)
    }


def without_those_of_ros(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values without the parameters that every ROS node has."""
    return {name: value for name, value in values.items() if name not in OF_ROS}


def parameter_files(arguments: Sequence[str]) -> list[Path]:
    """Return the parameter files that a command line gives to ROS."""
    return [Path(value) for flag, value in itertools.pairwise(arguments) if flag == "--params-file"]


def parse_assignment(text: str) -> tuple[str, Any]:
    """Parse ``name:=value`` of a ROS command line; the value is YAML.

    Raises:
        ConfigError: it has another form.
    """
    name, separator, value = text.partition(":=")
    if not (name and separator):
        raise ConfigError(f"parameter {shortened(text)}: expected name:=value")
    try:
        return name, parse_yaml(value)
    except ConfigError as error:
        raise ConfigError(
            f"parameter {name}: {shortened(value)} is not valid YAML: {error}"
        ) from error


def _sections(
    tree: Mapping[Any, Any], prefix: str, path: Path
) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield full name and parameters of every section; namespaces may be nested mappings."""
    for key, value in tree.items():
        name = f"{prefix}/{str(key).strip('/')}"
        if not isinstance(value, Mapping):
            raise ConfigError(
                f"{path}: {name}: expected {_SECTION}: {{...}}, got {shortened(value)}"
            )
        if _SECTION in value:
            if set(value) != {_SECTION} or not isinstance(value[_SECTION], Mapping):
                raise ConfigError(
                    f"{path}: section {name}: expected {_SECTION}: {{...}} alone, got"
                    f" {', '.join(list(value)[:SHOWN])}"
                )
            yield name, value[_SECTION]
        else:
            yield from _sections(value, name, path)


def _matches(section: str, node: str) -> bool:
    """Return whether a section's name matches a node.

    In the section's name, * stands for one word and ** for any number of words.
    """
    words, parts = section.strip("/").split("/"), node.strip("/").split("/")
    ends = {0}  # numbers of parts that the words so far can stand for
    for word in words:
        if word == "**":
            ends = set(range(min(ends), len(parts) + 1)) if ends else ends
        else:
            ends = {end + 1 for end in ends if end < len(parts) and word in {"*", parts[end]}}
    return len(parts) in ends
