# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Draw who imports whom among the folders of the code, in layers from top to bottom."""

from collections.abc import Sequence
from itertools import pairwise

from tools.measures.imports import Graph, circles, graph, without_shortcuts
from tools.measures.source import Module
from tools.pictures.svg import Drawing

SHARED = "shared modules"
"""Name of the modules of terrain_estimator that stand in no folder."""
_WIDTH, _BOX, _GAP, _HEIGHT, _STEP = 980, 134, 14, 34, 76
_SWEEPS = 24


def rooms(modules: list[Module]) -> Graph:
    """Return the folders of terrain_estimator and the other packages that each of them imports."""
    code = [
        module
        for module in modules
        if module.path.parts[0] == "studies"
        or (module.in_package and module.path.parts[0] == module.path.parts[1])
    ]
    home = {module.name: _room(module) for module in code}
    arrows: Graph = {room: set() for room in home.values()}
    for name, others in graph(code).items():
        arrows[home[name]] |= {home[other] for other in others} - {home[name]}
    return arrows


def packages_picture(modules: list[Module]) -> str:
    """Return the picture as SVG. An arrow that other arrows replace is left out.

    Raises:
        ValueError: folders import one another in a circle, so that none of them is at the top.
    """
    every = rooms(modules)
    if found := circles(every):
        named = "; ".join(", ".join(sorted(circle)) for circle in found)
        raise ValueError(f"no picture: these folders import one another in a circle: {named}")
    arrows = without_shortcuts(every)
    layers, links = _layers(arrows)
    places = _places(layers, links)
    drawing = Drawing(
        _WIDTH,
        _STEP * len(layers) - 6,
        "Who imports whom: commands, nodes and studies at the top, terramechanics at the bottom.",
    )
    level = {name: at for at, layer in enumerate(layers) for name in layer}
    for name, others in arrows.items():
        for other in sorted(others):
            way = _way(name, other, range(level[name] + 1, level[other]))
            drawing.path(_curve([places[each] for each in way]))
    for name in arrows:
        x, y = places[name]
        style = "data" if name in _OTHERS else "box"
        drawing.box(x - _BOX / 2, y, _BOX, _HEIGHT, name, style=style)
    return str(drawing)


_OTHERS = ("rover_parameters", "terramechanics", "rover_sim_node", "studies")


def _room(module: Module) -> str:
    top, *_ = module.name.split(".")
    if top != "terrain_estimator":
        return top
    return module.path.parts[2] if len(module.path.parts) > 3 else SHARED


def _layers(arrows: Graph) -> tuple[list[list[str]], Graph]:
    """Return the names by layer, top first, and the arrows from one layer to the next.

    An arrow over several layers passes through a place of its own in each of them, whose name holds
    both ends.
    """
    level = dict.fromkeys(arrows, 0)
    for _ in arrows:
        for name, others in arrows.items():
            level |= {other: max(level[other], level[name] + 1) for other in others}
    layers: list[list[str]] = [[] for _ in range(max(level.values()) + 1)]
    for name in sorted(arrows):
        layers[level[name]].append(name)
    links: Graph = {name: set() for name in arrows}
    for name, others in arrows.items():
        for other in sorted(others):
            passed = range(level[name] + 1, level[other])
            for at in passed:
                layers[at].append(f"{name}>{other}@{at}")
            for above, below in pairwise(_way(name, other, passed)):
                links.setdefault(above, set()).add(below)
    return layers, links


def _way(name: str, other: str, passed: range) -> list[str]:
    return [name, *(f"{name}>{other}@{at}" for at in passed), other]


def _places(layers: list[list[str]], links: Graph) -> dict[str, tuple[float, float]]:
    """Return the middle of the upper edge of each box [px], with few crossings.

    Each layer is sorted by the mean place of the neighbours, downwards and upwards in turns
    (Sugiyama, Tagawa and Toda 1981).
    """
    above: Graph = {}
    for name, others in links.items():
        for other in others:
            above.setdefault(other, set()).add(name)
    x: dict[str, float] = {}
    for layer in layers:
        x |= _spread(layer)
    for sweep in range(_SWEEPS):
        neighbours = links if sweep % 2 else above
        for layer in layers[::-1] if sweep % 2 else layers:
            wish = {
                name: _mean([x[other] for other in neighbours.get(name, ())], x[name])
                for name in layer
            }
            layer.sort(key=wish.__getitem__)
            x |= _spread(layer)
    for _ in range(_SWEEPS):
        for layer in layers:
            wish = {
                name: _mean(
                    [x[each] for each in (*links.get(name, ()), *above.get(name, ()))], x[name]
                )
                for name in layer
            }
            x |= _apart(layer, wish)
    return {name: (x[name], 18 + _STEP * at) for at, layer in enumerate(layers) for name in layer}


def _size(name: str) -> float:
    return 10 if "@" in name else _BOX


def _spread(layer: Sequence[str]) -> dict[str, float]:
    """Return evenly spread middles."""
    free = (_WIDTH - sum(map(_size, layer))) / (len(layer) + 1)
    places = {}
    at = free
    for name in layer:
        places[name] = at + _size(name) / 2
        at += _size(name) + free
    return places


def _apart(layer: Sequence[str], wish: dict[str, float]) -> dict[str, float]:
    """Return middles near the wishes, in order, that leave a gap between the boxes."""
    places: dict[str, float] = {}
    edge = _GAP / 2
    for name in layer:
        places[name] = max(wish[name], edge + _size(name) / 2)
        edge = places[name] + _size(name) / 2 + _GAP
    edge = _WIDTH - _GAP / 2
    for name in reversed(layer):
        places[name] = min(places[name], edge - _size(name) / 2)
        edge = places[name] - _size(name) / 2 - _GAP
    return places


def _mean(values: Sequence[float], otherwise: float) -> float:
    return sum(values) / len(values) if values else otherwise


def _curve(places: Sequence[tuple[float, float]]) -> str:
    """Return a smooth way down through the places, from the lower edge of the first box."""
    (x, y), *rest = places
    y += _HEIGHT
    path = f"M{x:g},{y:g}"
    for index, (later_x, later_y) in enumerate(rest):
        bend = (later_y - y) / 2
        path += f" C{x:g},{y + bend:g} {later_x:g},{later_y - bend:g} {later_x:g},{later_y:g}"
        x, y = later_x, later_y
        if index < len(rest) - 1:  # a place between two layers: straight past the boxes beside it
            y += _HEIGHT
            path += f" L{x:g},{y:g}"
    return path
