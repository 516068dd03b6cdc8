# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Draw the nodes and the topics between them: `python -m tools.pictures.nodes`."""

from pathlib import Path
from xml.etree import ElementTree as ET

from tools.pictures.svg import LINE, Drawing

ROOT = Path(__file__).parents[2]
PICTURE = ROOT / "docs/images/nodes.svg"
_POLICY = ROOT / "docs/examples/sros2/policy.xml"

_WIDTH = 860
_READERS = {
    "terrain_map": ("the ground on the track", "topic terrain_map"),
    "planner": ("margins, a stop", "topic traction_advice"),
    "dashboard": ("the live page", "a browser"),
    "watch": ("live lines", "a terminal"),
    "recorder": ("keeps every message", "a bag (MCAP)"),
}


def nodes_picture() -> str:
    """Return the picture as SVG."""
    drawing = Drawing(
        _WIDTH,
        446,
        "Nodes and topics: the simulator or a rover publishes measurements, the estimator turns"
        " them into estimates, and five nodes read both.",
    )
    _estimation(drawing)
    _readers(drawing)
    return str(drawing)


def _estimation(drawing: Drawing) -> None:
    inputs = _topics("estimator", "subscribe")
    outputs = _topics("estimator", "publish")
    drawing.box(20, 30, 150, 62, "simulator", ["or your rover's drivers"])
    drawing.box(20, 122, 150, 78, "slip_source", ["optional: slip from", "wheel rates, velocity"])
    drawing.box(240, 30, 170, 40 + LINE * len(inputs), "", [], style="data")
    _listed(drawing, 325, 30, "measurements, 10 Hz", inputs)
    drawing.box(475, 48, 130, 76, "estimator", ["cohesion, tan phi", "and covariance"])
    drawing.box(686, 30, 160, 40 + LINE * len(outputs), "", [], style="data")
    _listed(drawing, 766, 30, "estimates", outputs)
    for start, end, y in ((170, 240, 61), (410, 475, 86), (605, 686, 76)):
        drawing.arrow((start, y), (end, y))
    drawing.arrow((170, 140), (240, 140))
    drawing.text(204, 133, "wheel_slip", "label")


def _topics(node: str, verb: str) -> list[str]:
    """Return the topics of a node that the policy of security allows it."""
    found = ET.parse(_POLICY).iterfind(  # noqa: S314 (a file of ours)
        f".//profile[@node='{node}']/topics[@{verb}='ALLOW']/topic"
    )
    return [str(topic.text) for topic in found]


def _listed(drawing: Drawing, x: float, y: float, title: str, topics: list[str]) -> None:
    drawing.text(x, y + 20, title, "title")
    for index, topic in enumerate(topics):
        drawing.text(x, y + 40 + LINE * index, topic, "code")


def _readers(drawing: Drawing) -> None:
    bus, top, below = 250.0, 290.0, 390.0
    width, gap = 148.0, 20.0
    for start in ((325.0, 155.0), (766.0, 121.0)):
        drawing.arrow(start, (start[0], bus), head=False)
    centres = [20 + width / 2 + index * (width + gap) for index in range(len(_READERS))]
    drawing.arrow((centres[0], bus), (centres[-1], bus), head=False)
    drawing.text(542, bus - 8, "each reads the topics that it needs", "label")
    for x, (name, (what, out)) in zip(centres, _READERS.items(), strict=True):
        drawing.arrow((x, bus), (x, top))
        drawing.box(x - width / 2, top, width, 58, name, [what])
        drawing.arrow((x, top + 58), (x, below))
        kind, _, topic = out.partition("topic ")
        lines = [topic or kind]
        look = "code" if topic else "note"
        drawing.box(x - width / 2, below, width, 36, "", lines, style="data", line_style=look)
    right = centres[1] + width / 2
    drawing.arrow(
        (right, below + 18),
        (right + gap / 2, below + 18),
        (right + gap / 2, top + 29),
        (right + gap, top + 29),
    )


if __name__ == "__main__":
    PICTURE.write_text(nodes_picture(), encoding="utf-8")
