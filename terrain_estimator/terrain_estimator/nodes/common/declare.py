# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Declare a node's parameters beside the quality of service that a user may override."""

from collections.abc import Iterable, Sequence
from typing import TypeVar

from rclpy.node import Node

from rover_parameters import declare as strict
from rover_parameters.files import OVERRIDES
from terrain_estimator.nodes.common.qos import check_overrides

Config = TypeVar("Config")


def declare(
    node: Node,
    config: type[Config],
    topics: Iterable[str] = (),
    *,
    changeable: bool = False,
    fixed: Iterable[str] = (),
    arguments: Sequence[str] | None = None,
) -> Config:
    """Read and declare all parameters of ``config`` by :func:`rover_parameters.declare.declare`.

    Args:
        node: made with ``automatically_declare_parameters_from_overrides=True``.
        config: made of fields by ``rover_parameters.records``.
        topics: those whose subscriptions take ``qos_overrides``.
        changeable: as there.
        fixed: as there.
        arguments: as there.

    Raises:
        ConfigError: as there, or an override that no subscription has.
        SystemExit: with code 0 after ``--dump-config``.
    """
    overrides = {
        key: value for key, value in strict.given(node).items() if key.startswith(OVERRIDES)
    }
    check_overrides(overrides, map(node.resolve_topic_name, topics))
    return strict.declare(
        node,
        config,
        overrides,
        changeable=changeable,
        fixed=frozenset(fixed),
        arguments=arguments,
    )
