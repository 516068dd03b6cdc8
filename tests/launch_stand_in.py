# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The part of ROS's launch library that our launch files use.

The library has no wheel. Where it is not installed, this stand-in shows what they would start.

It keeps the declarations and resolves them: arguments with their defaults and choices, scopes of
groups, included files.
"""

import runpy
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

MODULES = (
    "launch",
    "launch.actions",
    "launch.event_handlers",
    "launch.events",
    "launch.substitutions",
    "launch_ros",
    "launch_ros.actions",
    "launch_ros.parameter_descriptions",
)
OURS = "terrain_estimator.nodes.common.launching"
NAMES = (
    "LaunchContext",
    "LaunchDescription",
    "DeclareLaunchArgument",
    "EmitEvent",
    "ExecuteProcess",
    "GroupAction",
    "IncludeLaunchDescription",
    "OpaqueFunction",
    "RegisterEventHandler",
    "OnProcessExit",
    "Shutdown",
    "Node",
    "ParameterValue",
    "ThisLaunchFileDir",
)


class Kept:
    """An entity with its arguments."""

    def __init__(self, *positional: Any, **named: Any) -> None:
        self.positional, self.named = positional, named


class LaunchConfiguration(Kept):
    def perform(self, context: "Context") -> str:
        return context.values[self.positional[0]]


class Context:
    """Values of the arguments in force, and the entities that were started."""

    def __init__(self, path: Path, arguments: dict[str, str]) -> None:
        self.folder, self.values, self.started = path.parent, arguments, list[Kept]()
        self.argv = [f"{name}:={value}" for name, value in arguments.items()]
        self.locals = SimpleNamespace(current_launch_file_path=str(path))

    def extend_globals(self, values: dict[str, Any]) -> None:
        vars(self.locals).update(values)

    def text(self, value: Any) -> str:
        """Resolve a text, a substitution, or a list of these."""
        if isinstance(value, list | tuple):
            return "".join(map(self.text, value))
        if isinstance(value, LaunchConfiguration):
            return value.perform(self)
        return str(self.folder) if isinstance(value, Kept) else str(value)

    def include(self, path: Path, given: dict[str, str]) -> None:
        """Start what a file declares; an unknown argument, which launch would ignore, fails."""
        entities = description(path)
        known = {
            entity.positional[0]
            for entity in entities
            if type(entity).__name__ == "DeclareLaunchArgument"
        }
        assert set(given) <= known, f"{path.name} has no argument {set(given) - known}"
        self.values |= given
        self.locals.current_launch_file_path = str(path)
        self._all(entities)

    def start(self, path: Path) -> None:
        """Start what the file declares that the user named."""
        self._all(description(path))

    def visit(self, entity: Kept) -> None:
        kind = type(entity).__name__
        if kind == "DeclareLaunchArgument":
            self._declare(entity)
        elif kind == "OpaqueFunction":
            self._all(entity.named["function"](self))
        elif kind == "GroupAction":
            before = dict(self.values)
            self._all(entity.positional[0])
            self.values = before
        elif kind == "IncludeLaunchDescription":
            self.include(
                Path(self.text(entity.positional[0])),
                {name: self.text(value) for name, value in entity.named["launch_arguments"]},
            )
        elif kind in {"Node", "ExecuteProcess"}:
            self.started.append(entity)

    def _all(self, entities: list[Kept]) -> None:
        for entity in entities:
            self.visit(entity)

    def _declare(self, argument: Kept) -> None:
        name = argument.positional[0]
        if name not in self.values:
            assert argument.named["default_value"] is not None, f"{name} has no default"
            self.values[name] = argument.named["default_value"]
        choices = argument.named.get("choices")
        assert not choices or self.values[name] in choices, f"{name}: {self.values[name]}"


@contextmanager
def library() -> Iterator[None]:
    """Put the stand-in in the place of the library's modules."""
    classes = {name: type(name, (Kept,), {}) for name in NAMES} | {
        "LaunchConfiguration": LaunchConfiguration
    }
    with pytest.MonkeyPatch.context() as patch:
        for name in MODULES:
            module = ModuleType(name)
            vars(module).update(classes)
            patch.setitem(sys.modules, name, module)
        patch.delitem(sys.modules, OURS, raising=False)
        yield
        sys.modules.pop(OURS, None)


def description(path: Path) -> list[Kept]:
    """Return the entities that a launch file declares."""
    entities: list[Kept] = runpy.run_path(str(path))["generate_launch_description"]().positional[0]
    return entities


def started(path: Path, **arguments: str) -> list[Kept]:
    """Return the nodes and processes that a launch file starts with these arguments."""
    context = Context(path, arguments)
    with library(), pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["ros2", "launch", str(path), *context.argv])
        context.start(path)
    return context.started


def declared(path: Path) -> dict[str, str]:
    """Return the descriptions of the arguments."""
    with library():
        return {
            entity.positional[0]: entity.named["description"]
            for entity in description(path)
            if type(entity).__name__ == "DeclareLaunchArgument"
        }
