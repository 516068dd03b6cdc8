# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Follow the imports between the modules of a tree."""

import ast
from collections.abc import Iterator, Mapping
from functools import cache

from tools.measures.source import Module

Graph = dict[str, set[str]]


def graph(modules: list[Module]) -> Graph:
    """Return the modules that each module imports, at its top or inside a function."""
    names = {module.name for module in modules}
    return {module.name: set(_imported(module, names)) - {module.name} for module in modules}


def _imported(module: Module, names: set[str]) -> Iterator[str]:
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in names)
        elif isinstance(node, ast.ImportFrom) and node.module in names:
            inner = {f"{node.module}.{alias.name}" for alias in node.names} & names
            yield from inner or {node.module}
        elif isinstance(node, ast.ImportFrom):
            yield from (
                f"{node.module}.{alias.name}"
                for alias in node.names
                if f"{node.module}.{alias.name}" in names
            )


def circles(arrows: Mapping[str, set[str]]) -> list[set[str]]:
    """Return the groups of modules that import one another, directly or by others."""
    reach = {name: _reachable(name, arrows) for name in arrows}
    groups = {
        frozenset(other for other in reach[name] if name in reach[other])
        for name in arrows
        if name in reach[name]
    }
    return [set(group) for group in groups]


def depth(arrows: Mapping[str, set[str]]) -> int:
    """Return the number of modules in the longest chain of imports; a circle counts once."""

    @cache
    def below(name: str) -> int:
        later = [other for other in arrows[name] if name not in reach[other]]
        return 1 + max(map(below, later), default=0)

    reach = {name: _reachable(name, arrows) for name in arrows}
    return max(map(below, arrows), default=0)


def without_shortcuts(arrows: Graph) -> Graph:
    """Return the arrows that no chain of other arrows replaces; the graph must have no circle."""
    reach = {name: _reachable(name, arrows) for name in arrows}
    return {
        name: {
            other
            for other in later
            if not any(other in reach[between] for between in later - {other})
        }
        for name, later in arrows.items()
    }


def _reachable(name: str, arrows: Mapping[str, set[str]]) -> set[str]:
    found: set[str] = set()
    waiting = list(arrows[name])
    while waiting:
        other = waiting.pop()
        if other not in found:
            found.add(other)
            waiting.extend(arrows[other])
    return found
