# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The table of docs/messages.md is what the nodes offer."""

import re
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.system.listening import Listener
from tests.system.processes import Starter

ROW = re.compile(r"^\| `([\w/]+)` \| `([\w/]+)` \| (\w+) \| [^|]+ \| (\w+) \| (\w+) \| (\d+) \|$", re.MULTILINE)
TABLE = ROW.findall((Path(__file__).parents[2] / "docs/messages.md").read_text(encoding="utf-8"))
PACKAGE_OF = {
    "simulator": "rover_sim_node",
    "estimator": "terrain_estimator",
    "planner": "terrain_estimator",
    "terrain_map": "terrain_estimator",
}


class Offer(NamedTuple):
    """What discovery tells about a publisher (it does not tell the depth)."""

    topic: str
    type: str
    reliability: str
    durability: str


@pytest.mark.parametrize("node", sorted(PACKAGE_OF))
def test_a_node_offers_what_the_table_says(node: str, start: Starter, listener: Listener) -> None:
    documented = {
        Offer(topic, kind, reliability, durability) for topic, kind, publisher, reliability, durability, _ in TABLE if publisher == node
    }
    process = start(PACKAGE_OF[node], node)

    def offered() -> set[Offer]:
        assert process.running, process.output
        return {
            Offer(topic, info.topic_type, info.qos_profile.reliability.name.lower(), info.qos_profile.durability.name.lower())
            for topic, *_ in TABLE
            for info in listener.node.get_publishers_info_by_topic(topic)
            if info.node_name == node
        }

    listener.spin_until(lambda: offered() == documented, "the offers are those of the table", seen=lambda: f"{offered()} not {documented}")
    assert documented
    assert process.interrupt() == 0
