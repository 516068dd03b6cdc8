# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Content of the live page from messages: present values, their history, and changes.

It needs constant memory, and has no clock and no ROS.
"""

import json
import math
from collections import deque
from dataclasses import asdict, dataclass
from typing import Any

from terrain_estimator.config.dashboard import ShownConfig
from terrain_estimator.dashboard.history import ChartHistory, Row
from terrain_estimator.dashboard.journal import Journal
from terrain_estimator.dashboard.reported_states import reported_states
from terrain_estimator.dashboard.values import TOPICS, Values
from terrain_estimator.messaging.diagnostics import Level
from terrain_estimator.messaging.messages import Status
from terrain_estimator.messaging.pairing import RESTART_AFTER
from terrain_estimator.outcome import Outcome
from terrain_estimator.pages.number_format import finite
from terrain_estimator.topics import Message, stamp_ns

STALE_S = 2.5
"""[s] Age by the steady clock from which a value is left out of a row."""
JUMP_S = 10.0
"""[s] Step ahead from which a stamp must be confirmed by several in a row."""
BACK_S = 1.0
"""[s] Step back from which a stamp must be confirmed.

A bag that loops may be short, and topics of one instant are not this far apart.
"""
TIMED = ("terrain_estimate", "wheel_slip", "wheel_sinkage", "odom")
"""Topics whose stamps are times of measurement."""
LATE = 5
"""Number of instants that wait for their last message, since topics keep no order among them."""

_BOUNDS = ("", "_lower_95", "_lower_68", "_upper_68", "_upper_95")
_ESTIMATED = tuple(f"{name}{bound}" for name in ("cohesion", "tan_phi") for bound in _BOUNDS)
_PLACE = ("x", "y", "z", "velocity")
_TRUTH = "ground_truth/terrain"  # published once
_WORST = ("change_probability", "outcome", "health")


@dataclass(frozen=True, slots=True)
class Cursor:
    """State of a viewer: the rows and events that it has, and the histories that they belong to."""

    of: str = ""
    recent: int = 0
    whole: int = 0
    journal: int = 0


@dataclass(frozen=True, slots=True)
class Instant:
    """Values of the topics at one stamp [s]."""

    stamp_s: float
    values: dict[str, Values]


class LiveModel:
    """Content of the page; each viewer gets the part that it lacks."""

    def __init__(
        self, session: str, config: ShownConfig, resume_service: str = "/planner/resume"
    ) -> None:
        """Start without messages; ``session`` identifies this run of the node."""
        self._session, self._config = session, config
        self._resume_service = resume_service
        self.revision = 0  # grows with every message
        self._now: dict[str, Values] = {}
        self._received_s: dict[str, float] = {}
        self._wheels: tuple[str, ...] = ()
        self._generation = -1
        self._begin()

    def _begin(self) -> None:
        """Start empty histories, with columns for the known wheels."""
        wheels = [f"{name}_{k}" for name in ("slip", "sinkage") for k in range(len(self._wheels))]
        self.columns = (
            "time",
            *_ESTIMATED,
            *_WORST,
            "status",
            *_PLACE,
            "truth_cohesion",
            "truth_tan_phi",
            *wheels,
        )
        worst = frozenset(self.columns.index(name) for name in _WORST)
        mean = frozenset(self.columns.index(name) for name in wheels)
        period_s, points = self._config.window_s / self._config.points, self._config.points
        self._recent = ChartHistory(period_s, points, whole=False, worst=worst)
        self._whole = ChartHistory(period_s, points, whole=True, worst=worst, mean=mean)
        self._journal = Journal()
        self._stamp_s = self._origin_s = math.nan
        self._stamps_s: dict[str, float] = {}  # newest stamp of each timed topic
        self._waiting: deque[Instant] = deque()
        self._jumps = 0
        self._generation += 1

    def take(self, topic: str, message: Message, now_s: float) -> None:
        """Take a message of one of ``TOPICS``.

        ``now_s`` is the time by the steady clock. A malformed message raises ValueError or
        IndexError.
        """
        values = TOPICS[topic][1](message)
        if topic == "wheel_slip" and tuple(values["wheel"]) != self._wheels:
            self._wheels = tuple(values["wheel"])
            self._begin()
        if topic in TIMED and self._advance(stamp_s := stamp_ns(message) * 1e-9, now_s):
            self._stamps_s[topic] = stamp_s
            for instant in self._waiting:
                if instant.stamp_s >= stamp_s:
                    instant.values[topic] = values
        self._now[topic], self._received_s[topic] = values, now_s
        self._complete(now_s)
        self.revision += 1
        if not math.isnan(self._stamp_s):
            for each in reported_states(topic, values):
                self._journal.see(each.lane, each.state, self._stamp_s, each.level, each.text)

    def _advance(self, stamp_s: float, now_s: float) -> bool:
        """Let the present instant wait when a later stamp arrives; return False for a wild one."""
        step_s = 0.0 if math.isnan(self._stamp_s) else stamp_s - self._stamp_s
        if step_s > JUMP_S or step_s < -BACK_S:
            self._jumps += 1
            if self._jumps < RESTART_AFTER:
                return False
            if step_s < 0.0:
                self._begin()
                self._journal.write(
                    stamp_s,
                    "warn",
                    f"stamps went back by {-step_s:.0f} s: the history starts again",
                )
        self._jumps = 0
        if math.isnan(self._stamp_s):
            self._stamp_s = self._origin_s = stamp_s
        elif step_s > 0.0:
            values = {
                topic: self._now[topic]
                for topic in self._now
                if topic == _TRUTH or self._is_fresh(topic, now_s)
            }
            self._waiting.append(Instant(self._stamp_s, values))
            self._stamp_s = stamp_s
        return True

    def _is_fresh(self, topic: str, now_s: float) -> bool:
        return now_s - self._received_s[topic] < STALE_S

    def _complete(self, now_s: float) -> None:
        """Make rows of the instants that every topic has passed, and of those that wait too long.

        A topic that is not heard any more is not waited for.
        """
        reached = min(
            (at for topic, at in self._stamps_s.items() if self._is_fresh(topic, now_s)),
            default=math.inf,
        )
        while self._waiting and (len(self._waiting) > LATE or self._waiting[0].stamp_s < reached):
            row = self._row(self._waiting.popleft())
            self._recent.add(row)
            self._whole.add(row)

    def _row(self, instant: Instant) -> Row:
        known = instant.values
        estimate, place, health, truth = (
            known.get(topic, {})
            for topic in ("terrain_estimate", "odom", "estimator_health", _TRUTH)
        )
        values = [estimate.get(name) for name in (*_ESTIMATED, "change_probability")]
        values += [
            Outcome[estimate["outcome"]] if estimate else None,
            Level[health["level"]] if health else None,
        ]
        values += [Status[estimate["status"]] if estimate else None]
        values += [place.get(name) for name in _PLACE] + [
            truth.get("cohesion"),
            truth.get("tan_phi"),
        ]
        for topic, name in (("wheel_slip", "slip"), ("wheel_sinkage", "sinkage")):
            measured = known.get(topic, {"wheel": (), name: ()})
            by_wheel = dict(zip(measured["wheel"], measured[name], strict=False))
            values += [by_wheel.get(wheel) for wheel in self._wheels]
        return (
            round(instant.stamp_s - self._origin_s, 3),
            *(None if value is None else float(f"{value:.7g}") for value in values),
        )

    def update(self, cursor: Cursor, now_s: float) -> str:
        """Return what a viewer with this cursor lacks, as JSON.

        A cursor of other histories gets everything.
        """
        of = f"{self._session}/{self._generation}/{self._whole.generation}"
        anew = cursor.of != of
        known = Cursor(of) if anew else cursor
        answer: dict[str, Any] = {
            "cursor": asdict(Cursor(of, self._recent.end, self._whole.end, self._journal.end)),
            "recent": self._recent.since(known.recent),
            "whole": self._whole.since(known.whole),
            "journal": [asdict(event) for event in self._journal.since(known.journal)],
            "now": self._now,
            "ages": {
                topic: round(now_s - received_s, 3)
                for topic, received_s in self._received_s.items()
            },
            "time": finite(self._stamp_s),
            "origin": finite(self._origin_s),
        }
        if anew:
            answer["begin"] = {
                "columns": self.columns,
                "wheels": self._wheels,
                "window": self._config.window_s,
                "resume": self._resume_service,
                "outcomes": [each.name for each in Outcome],
                "statuses": [each.name for each in Status],
                "levels": [each.name for each in Level],
            }
        return json.dumps(answer, allow_nan=False, separators=(",", ":"))
