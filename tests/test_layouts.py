# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The layouts for Foxglove, Lichtblick and PlotJuggler show topics and fields that exist."""

import json
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from ament_index_python import get_package_share_directory

from terrain_estimator.bags import Types
from terrain_estimator.messaging.map_track import POINT
from terramechanics.presets import load_rover

ROOT = Path(__file__).parents[1]
LAYOUTS = ROOT / "terrain_estimator/layouts"
WHEELS = len(load_rover("mars_rover").wheels)
TYPES = Types()
NUMBER = (bool, int, float)


@cache
def topics() -> dict[str, str]:
    """Return the type of every topic, from the table that a test compares with the nodes."""
    rows = re.findall(
        r"^\| `(/?[\w/]+)` \| `([\w/]+)` \|",
        (ROOT / "docs/messages.md").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    return {f"/{topic.lstrip('/')}": kind for topic, kind in rows}


@cache
def foxglove() -> dict[str, Any]:
    content: dict[str, Any] = json.loads((LAYOUTS / "foxglove.json").read_text(encoding="utf-8"))
    return content


def value_at(topic: str, parts: list[str]) -> object:
    """Return a field of a message of the topic.

    KeyError and AttributeError name what does not exist.
    """
    value = TYPES.make(topics()[topic])
    for part in parts:
        name, _, index = part.partition("[")
        value = getattr(value, name)
        if index:
            assert int(index.rstrip("]")) < WHEELS, part
            assert isinstance(value, np.ndarray), part
            value = 0.0
    return value


def panels(kind: str) -> dict[str, dict[str, Any]]:
    return {
        name: panel
        for name, panel in foxglove()["configById"].items()
        if name.startswith(f"{kind}!")
    }


def paths(kind: str) -> Iterator[tuple[str, list[str]]]:
    """Yield topic and fields of every series; a number is a line across the plot."""
    for panel in panels(kind).values():
        for series in panel["paths"]:
            if not re.fullmatch(r"-?[\d.]+", series["value"]):
                topic, *fields = series["value"].split(".")
                yield topic, fields


def leaves(node: Any) -> list[str]:
    """Return the panels of a mosaic."""
    return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]


def test_every_series_of_a_plot_is_a_number_of_a_message() -> None:
    found = list(paths("Plot"))
    assert len(found) > 30
    for topic, fields in found:
        assert isinstance(value_at(topic, fields), NUMBER), (topic, fields)


def test_every_state_that_is_shown_is_a_field_of_a_message() -> None:
    found = list(paths("StateTransitions"))
    assert len(found) >= 3
    for topic, fields in found:
        assert isinstance(value_at(topic, fields), (*NUMBER, str)), (topic, fields)


def test_the_map_and_the_diagnostics_are_those_that_are_published() -> None:
    (shown,) = panels("3D").values()
    ((cloud, settings),) = shown["topics"].items()
    assert topics()[cloud] == "sensor_msgs/msg/PointCloud2"
    assert settings["colorField"] in (POINT.names or ())
    (checks,) = panels("DiagnosticSummary").values()
    assert topics()[checks["topicToRender"]] == "diagnostic_msgs/msg/DiagnosticArray"


def test_every_panel_has_its_place_and_is_of_a_kind_that_the_viewers_have() -> None:
    placed = leaves(foxglove()["layout"])
    for name in list(placed):
        placed += [
            leaf
            for tab in foxglove()["configById"][name].get("tabs", [])
            for leaf in leaves(tab["layout"])
        ]
    assert sorted(placed) == sorted(foxglove()["configById"])
    assert {name.split("!")[0] for name in placed} == {
        "Plot",
        "StateTransitions",
        "3D",
        "DiagnosticSummary",
        "Tab",
    }


def test_every_curve_of_plotjuggler_is_a_number_of_a_message() -> None:
    curves = [
        str(curve.get("name"))
        for curve in ET.parse(LAYOUTS / "plotjuggler.xml").getroot().iter("curve")
    ]
    assert len(curves) > 30
    for curve in curves:
        topic = max(
            (topic for topic in topics() if curve.startswith(f"{topic}/")), key=len, default=curve
        )
        assert isinstance(value_at(topic, curve.removeprefix(f"{topic}/").split("/")), NUMBER), (
            curve
        )


@pytest.mark.parametrize(
    ("topic", "fields"),
    [
        ("/wheel_slip", ["slop[0]"]),
        ("/wheel_slip", ["slip[6]"]),
        ("/wheel_slop", ["slip[0]"]),
        ("/odom", ["twist.x"]),
    ],
)
def test_the_check_finds_what_does_not_exist(topic: str, fields: list[str]) -> None:
    with pytest.raises((KeyError, AttributeError, AssertionError)):
        value_at(topic, fields)


def test_an_installed_workspace_has_the_layouts() -> None:
    installed = Path(get_package_share_directory("terrain_estimator")) / "layouts"
    ours = sorted(path.name for path in LAYOUTS.iterdir())
    assert ours == sorted(path.name for path in installed.iterdir())
    assert all((installed / name).read_bytes() == (LAYOUTS / name).read_bytes() for name in ours)
