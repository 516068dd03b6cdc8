# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The decisions about observations, in numbers and words."""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

from terrain_estimator.estimator.off_plane import SingleWheels
from terrain_estimator.estimator.screening import Screening
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.report import Report
from terrain_estimator.model.row_names import BESIDE, ROLL_MOMENT
from terrain_estimator.observation import Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import Decision

_NAN = math.nan
# [1] a squared distance further below zero is the difference of huge terms, without a posterior
_ROUNDING = 1.0


def without_rows(outcome: Outcome, detail: str, settled: int = 0) -> Decision:
    """Return the decision on an observation of which no row was compared with the model."""
    return Decision(outcome, (), _NAN, _NAN, 0, detail, settled)


def is_failure(report: Report) -> bool:
    """Return whether rounding left no numbers to go on with."""
    return not report.finite or report.misfit < -_ROUNDING


@dataclass(frozen=True, slots=True)
class Deciding:
    """The decisions about observations that a model has seen."""

    moments: tuple[str, ...]  # rows of the model that are balances of moments
    beside: tuple[str, ...]  # rows of the model that every observation has
    load: bool  # whether the load row counts
    wheels: tuple[str, ...]  # names; none of a model by axle
    needs_rates: bool  # whether a wheel without a rate is outside the model's range

    @classmethod
    def of(cls, model: LoadedModel, wheels: SingleWheels | None) -> "Deciding":
        """Take the rows of a model; ``wheels`` where it is one by wheel."""
        return cls(
            tuple(row for row in model.used_rows if "moment" in row),
            tuple(row for row in model.used_rows if row in BESIDE),
            "load" in model.used_rows,
            wheels.names if wheels else (),
            bool(model.effects),
        )

    def out_of_range(self, usable: Sequence[bool]) -> Decision:
        """Refuse an observation of which not every wheel is ``usable``."""
        outside = [k for k, each in enumerate(usable) if not each]
        which = f"axles {outside}"
        if self.wheels:
            which = f"wheels {', '.join(self.wheels[k] for k in outside)}"
        needed = ", or have no wheel rate, which this model needs" if self.needs_rates else ""
        return without_rows(Outcome.OUT_OF_RANGE, f"{which} are outside the model's range{needed}")

    def gated(self, velocity: float, report: Report, gate: float) -> Decision:
        """Refuse an observation whose velocity [m/s] is too far from the expected one.

        ``gate`` [1] is the largest squared distance that passes.
        """
        expected = velocity - report.innovation
        detail = f"velocity {velocity:.4g} m/s, expected {expected:.4g} m/s"
        return Decision(Outcome.GATED, (), report.distance, gate, 1, detail)

    def accepted(
        self, screening: Screening, torque: list[float], distance: float, gate: float, settled: int
    ) -> Decision:
        """Accept an observation with the rows that it measured.

        ``torque`` [W] [N m] is that of each wheel on the ground, NaN where it is not known;
        ``distance`` [1] the squared one of the velocity, up to ``gate`` [1], infinite for none;
        ``settled`` the number of observations that entered the posterior with this one.
        """
        observation = screening.observation
        rows = _rows(
            tuple(map(math.isfinite, torque)),
            math.isfinite(observation.acceleration),
            self._balances(observation),
        )
        return Decision(
            screening.outcome,
            rows + self.beside,
            distance,
            gate if math.isfinite(gate) else _NAN,  # no gate applies
            0 if math.isnan(distance) else 1,
            screening.detail,
            settled,
        )

    def _balances(self, observation: Observation) -> tuple[str, ...]:
        # less what turns the wheel, which is unknown without its rate
        moments = self.moments if math.isfinite(observation.bogie_angle) else ()
        # without sinkages the other balances are spent on them
        if not self.load or math.isnan(observation.sinkage[0]):
            return tuple(row for row in moments if row == ROLL_MOMENT)
        return ("load", *moments)


@functools.lru_cache
def _rows(
    torques: tuple[bool, ...],
    acceleration: bool,  # noqa: FBT001 (of a cached function)
    balances: tuple[str, ...],
) -> tuple[str, ...]:
    """Return the rows of an observation by what it measured, and the ``balances`` that are left."""
    rows = ["velocity", *balances[:1]]
    rows += [f"torque_{axle}" for axle, known in enumerate(torques) if known]
    rows += ["acceleration"] if acceleration else []
    return (*rows, *balances[1:])
