# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Quality of service as rosbag2 stores it."""

from dataclasses import dataclass
from typing import Any

import yaml

from rover_parameters.records import ConfigError
from rover_parameters.yaml_files import parse_yaml

INFINITE_NS = 2**63 - 1  # RMW_DURATION_INFINITE


@dataclass(frozen=True, slots=True)
class Qos:
    """Quality of service that a publisher offers, in rosbag2's terms; durations in nanoseconds."""

    history: str = "keep_last"
    depth: int = 50
    reliability: str = "reliable"
    durability: str = "volatile"
    deadline_ns: int = INFINITE_NS
    lifespan_ns: int = INFINITE_NS
    liveliness: str = "automatic"
    liveliness_lease_ns: int = INFINITE_NS
    avoid_ros_namespace_conventions: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return the fields in the form of metadata version 9.

        Source: ``rosbag2_storage/src/rosbag2_storage/qos.cpp``.
        """
        return {
            "history": self.history,
            "depth": self.depth,
            "reliability": self.reliability,
            "durability": self.durability,
            "deadline": _duration(self.deadline_ns),
            "lifespan": _duration(self.lifespan_ns),
            "liveliness": self.liveliness,
            "liveliness_lease_duration": _duration(self.liveliness_lease_ns),
            "avoid_ros_namespace_conventions": self.avoid_ros_namespace_conventions,
        }


STATE = Qos(durability="transient_local", depth=10)


def qos_text(profiles: tuple[Qos, ...]) -> str:
    """Return the YAML of a channel's ``offered_qos_profiles``."""
    return (
        yaml.safe_dump([profile.as_dict() for profile in profiles], sort_keys=False)
        if profiles
        else ""
    )


def parse_qos(text: str) -> tuple[Qos, ...]:
    """Parse a channel's ``offered_qos_profiles``; empty unless it is of version 9."""
    try:
        profiles: Any = parse_yaml(text)
        return tuple(_of_dict(fields) for fields in profiles or ())
    except (ConfigError, KeyError, TypeError, ValueError, OverflowError):
        return ()


def _of_dict(fields: dict[str, Any]) -> Qos:
    return Qos(
        history=str(fields["history"]),
        depth=int(fields["depth"]),
        reliability=str(fields["reliability"]),
        durability=str(fields["durability"]),
        deadline_ns=_nanoseconds(fields["deadline"]),
        lifespan_ns=_nanoseconds(fields["lifespan"]),
        liveliness=str(fields["liveliness"]),
        liveliness_lease_ns=_nanoseconds(fields["liveliness_lease_duration"]),
        avoid_ros_namespace_conventions=bool(fields["avoid_ros_namespace_conventions"]),
    )


def _nanoseconds(fields: dict[str, Any]) -> int:
    return int(fields["sec"]) * 1_000_000_000 + int(fields["nsec"])


def _duration(nanoseconds: int) -> dict[str, int]:
    sec, nsec = divmod(nanoseconds, 1_000_000_000)
    return {"sec": sec, "nsec": nsec}
