# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the tests that start processes: a ROS domain, a starter, a listener."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.domains import own_domain
from tests.system.listening import Listener
from tests.system.processes import Starter


@pytest.fixture
def domain_id() -> Iterator[int]:
    """Reserve a ROS domain that no other test uses, in other runs on this machine neither."""
    with own_domain() as reserved:
        yield reserved


@pytest.fixture
def start(tmp_path: Path, domain_id: int) -> Iterator[Starter]:
    """start("rover_sim_node", "simulator", "--ros-args", "-p", "seed:=1") returns a Process."""
    with Starter(tmp_path, domain_id) as starter:
        yield starter


@pytest.fixture
def listener(domain_id: int) -> Iterator[Listener]:
    """Make a node of the test itself, in the domain of what `start` starts."""
    with Listener(domain_id) as node:
        yield node
