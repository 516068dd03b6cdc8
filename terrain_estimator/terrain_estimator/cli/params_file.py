# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the parameter files of ROS 2, without ROS, as the estimator node would."""

from pathlib import Path
from typing import Any

import yaml

from terrain_estimator.parameters import ParameterError

NODE = "estimator"
_SECTIONS = ("/**", "/*", NODE, f"/{NODE}", f"/**/{NODE}")
_OF_ROS = ("use_sim_time", "qos_overrides")


def read_parameters(path: Path) -> dict[str, Any]:
    """The parameters of a file like ``estimator: {ros__parameters: {model: ...}}``; later sections win.

    Raises:
        ParameterError: the file cannot be read, is no such file, or has no section for the estimator.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ParameterError(f"{path}: cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ParameterError(f"{path}: not valid YAML: {error}") from error
    sections = content if isinstance(content, dict) else {}
    found = {name: section for name, section in sections.items() if name in _SECTIONS or str(name).endswith(f"/{NODE}")}
    if not found:
        raise ParameterError(f"{path}: has no section for the node: expected {NODE}: {{ros__parameters: {{...}}}}, got {_keys(content)}")
    values: dict[str, Any] = {}
    for name, section in found.items():
        if not isinstance(section, dict) or set(section) != {"ros__parameters"} or not isinstance(section["ros__parameters"], dict):
            raise ParameterError(f"{path}: section {name}: expected ros__parameters: {{...}}, got {_keys(section)}")
        values |= section["ros__parameters"]
    return {name: value for name, value in values.items() if name not in _OF_ROS}


def parse_assignment(text: str) -> tuple[str, Any]:
    """``name:=value`` as ROS takes it on the command line; the value is YAML.

    Raises:
        ParameterError: it has another form.
    """
    name, separator, value = text.partition(":=")
    if not (name and separator):
        raise ParameterError(f"parameter {text!r}: expected name:=value")
    try:
        return name, yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise ParameterError(f"parameter {name}: {value!r} is not valid YAML: {error}") from error


def _keys(content: object) -> str:
    return ", ".join(map(str, content)) if isinstance(content, dict) else f"a {type(content).__name__}"
