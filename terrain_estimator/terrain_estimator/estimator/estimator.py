# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The estimator: one observation in, one update out, without a clock, a log or a file."""

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rover_parameters.records import ConfigError
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.configured import as_configured
from terrain_estimator.estimator.consistency import Consistency, SecondFit, law_in_doubt, limit
from terrain_estimator.estimator.crossing import wheelbases
from terrain_estimator.estimator.deciding import Deciding, is_failure, without_rows
from terrain_estimator.estimator.forecasting import Forecast, Forecasting
from terrain_estimator.estimator.intake import Intake
from terrain_estimator.estimator.memory import Memory
from terrain_estimator.estimator.off_plane import SingleWheels
from terrain_estimator.estimator.restored_state import ADVICE, Counts, EstimatorParts, State, judged
from terrain_estimator.estimator.saved_state import Arrays, StateFileError
from terrain_estimator.estimator.screening import Screening, advised, screen
from terrain_estimator.estimator.soundness import unsound_answer, unsound_fit
from terrain_estimator.estimator.summary import Beliefs, Summary, named, summary_of
from terrain_estimator.estimator.wheel_tracks import WheelTracks
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.packed_observation import (
    LONGEST_GAP,
    TurningBody,
    ground_torque,
    link,
    pack,
)
from terrain_estimator.model.report import Report
from terrain_estimator.model.runtime import RuntimeState
from terrain_estimator.observation import NOT_SAVED, Observation
from terrain_estimator.outcome import Outcome
from terrain_estimator.update import (
    NOTHING_PREDICTED,
    Decision,
    Disagreement,
    Estimate,
    Prediction,
    Update,
)

_PATIENCE = 15
"""Blocks in a row that fit no ground at all, after which the prior holds again.

A rover whose axles are on different ground while it crosses a border passes within that time.
"""


class Estimator:
    """Recursive estimate of cohesion and friction angle, and prediction of the velocity."""

    def __init__(self, model: LoadedModel, config: CoreConfig) -> None:
        """Take a checked model and the core's parameters.

        Raises:
            ConfigError: the prior is unknown to the model, or gives no sound estimate.
        """
        self._runtime = model.runtime
        self._rover = model.rover
        self._rows, self._stations = model.rows, model.metadata.stations
        self._effects = model.effects
        self._law_in_doubt = law_in_doubt(effect.name for effect in model.effects)
        config = config.of_model(by_wheel=bool(model.metadata.wheels))
        if not (config.use_sinkage or model.balances_sinkage):
            raise ConfigError(
                f"parameter use_sinkage: model {model.model_id} needs every sinkage: it has named"
                " effects, another contact law, a torque gain that is not known, more axles than"
                " balances tell the loads of, or the velocity row alone: set it to true"
            )
        if model.metadata.wheels and not config.use_torque:
            raise ConfigError(
                f"parameter use_torque: model {model.model_id} is by wheel, and without torques"
                " nothing tells c from tan phi, so that its intervals do not hold: set it to true"
            )
        if model.metadata.velocity_alone:
            config = config.of_velocity_alone()
        self._config, self._balances_sinkage = config, model.balances_sinkage
        self._wheels, self._body = SingleWheels.of(model.metadata), _turning_body(model)
        places = model.metadata.wheel_places
        self._tracks = WheelTracks(model.rover, places, config.standstill_speed)
        self._deciding = Deciding.of(model, self._wheels)
        self._step_s, self._block = model.metadata.step_s, model.metadata.block
        self._beliefs = Beliefs.of(model.metadata, config)
        self._gate = limit(config.gate_probability, 1)
        self._sequence = 0
        self.reopened = 0  # times that the prior came back by itself
        self.reset()
        self._prior = self._published.estimate
        if reason := self._published.unsound:
            raise ConfigError(
                f"parameters prior.*: the prior's {reason}: give means and deviations of soils, in"
                " Pa and 1"
            )
        self._memory = Memory.of(self._runtime, self._start(), self._rows)

    def reset(self) -> None:
        """Forget everything but the sequence number."""
        self._intake = Intake()
        self._consistency = Consistency(self._rows)
        self._judge()
        self._forecasting = Forecasting()
        self._reopen()
        self._last_stamp: int | None = None  # the last one that came
        self._tracks.forget()

    def _reopen(self) -> None:
        """Start over from the prior; how well the model fitted is kept."""
        self._state = self._start()
        self._last: Observation | None = None  # the last one that was accepted
        self._intake = Intake(self._intake.window, self._intake.alone)
        self._contradictions = 0
        self._change = 0.0  # probability that the ground changed, as of the last closed block
        self._doubt = 0.0  # probability that the ground is one that no block fitted yet
        self._forecasting.forget()
        self._summarise()

    def _start(self) -> RuntimeState:
        """Return the model's state before the first observation, with the prior in use."""
        beliefs = self._beliefs
        soils = np.array(beliefs.prior_soils)
        return self._runtime.initial_with_prior(
            beliefs.prior_mean, beliefs.prior_sd, soils, self._config.drift
        )

    def update(self, observation: Observation) -> Update:
        """Take one observation and return the update, whose decision tells its use.

        The content of an observation never raises.
        """
        if self._config.use_sinkage:
            observation = self._tracks.undisturbed(observation)
        observation = as_configured(observation, self._rover, self._config)
        screening = screen(
            observation,
            self._last_stamp,
            self._rover,
            self._config,
            sinkage_needed=not self._balances_sinkage,
            wheels=self._wheels,
        )
        if screening.outcome not in (Outcome.TIME_BACKWARDS, Outcome.DUPLICATE):
            self._last_stamp = observation.stamp_ns
        if screening.outcome.used:
            return self._learn(self._explained(screening))
        detail = advised(self._explained(screening), self._config).detail
        return self._answer(observation.stamp_ns, without_rows(screening.outcome, detail))

    def _explained(self, screening: Screening) -> Screening:
        """Return the screening with the reason why a local sinkage tells nothing, if it does."""
        partial = screening.outcome in {Outcome.NOT_FINITE, Outcome.ACCEPTED_PARTIALLY}
        if not (self._tracks.lacks and partial):
            return screening
        return screening._replace(detail=f"{screening.detail}; {self._tracks.lacks}")

    def reject(self, stamp_ns: int, outcome: Outcome, detail: str) -> Update:
        """Answer for an observation that could not even be formed."""
        return self._answer(stamp_ns, without_rows(outcome, detail))

    @property
    def last_stamp_ns(self) -> int | None:
        """Stamp of the last observation that came, None where none did."""
        return self._last_stamp

    def set_gate_probability(self, probability: float) -> None:
        """Refuse this share of good observations from the next one on; 0: none."""
        self._config = dataclasses.replace(self._config, gate_probability=probability)
        self._gate = limit(probability, 1)

    def save(self) -> dict[str, NDArray[Any]]:
        """Return all that the next update depends on, as arrays, but for the sequence number."""
        last = {} if self._last is None else dataclasses.asdict(self._last)
        last = {name: value for name, value in last.items() if name not in NOT_SAVED}
        intake, moving = self._intake, self._forecasting.persistence
        return {
            **{f"state.{k}": value for k, value in self._runtime.arrays(self._state).items()},
            **{f"last.{name}": np.asarray(value) for name, value in last.items()},
            "counts": np.array(
                [
                    -1 if self._last_stamp is None else self._last_stamp,
                    intake.used,
                    intake.waiting,
                    self._contradictions,
                    -1 if moving.stamp_ns is None else moving.stamp_ns,
                    intake.alone,
                ],
                dtype=np.int64,
            ),
            "numbers": np.array(
                [
                    intake.time_used_s,
                    intake.time_waiting_s,
                    self._change,
                    self._doubt,
                    *self._forecasting.published,
                    *self._forecasting.model,
                    *moving[1:],
                    *self._forecasting.hindsight,
                    self._consistency.crossing.way,
                    self._consistency.crossing.same_way,
                ]
            ),
            "window": np.array(intake.window, dtype=np.int64).reshape(-1, 3),
            **self._consistency.arrays(),
            **self._tracks.arrays(),
        }

    def restore(self, arrays: Arrays) -> None:
        """Go on from what :meth:`save` gave, of an estimator with the same model.

        Raises:
            StateFileError: the arrays are not those of a state of this model and prior, or hold
                numbers that it cannot have; nothing is changed then.
        """
        runtime = self._runtime
        parts = EstimatorParts(
            runtime.arrays(self._start()),
            runtime.arrays(runtime.initial()),
            self._published_with,
            self._rows,
            self._stations,
            self._wheels is not None,
            self._rover.wheel_radius,
            self._block,
            self._step_s,
        )
        found, last, counts = judged(arrays, parts)
        state = runtime.state_of(found)
        summary = self._summary(state, counts.doubt, counts.consistency.crossing.unknown)
        if summary.unsound:
            raise StateFileError(f"the state gives no estimate: {summary.unsound}: {ADVICE}")
        self._tracks.restore(arrays)
        self._state, self._last, self._published = state, last, summary
        self._count(counts)

    def _published_with(self, state: State, bank: State) -> State:
        """Return the arrays of a state with all that a bank implies."""
        runtime = self._runtime
        return runtime.arrays(runtime.publish(runtime.state_of(state), bank))

    def _count(self, counts: Counts) -> None:
        """Go on from the counts and numbers of a saved state."""
        self._last_stamp = counts.stamp_ns
        self._contradictions = counts.contradictions
        self._change, self._doubt = counts.change, counts.doubt
        self._forecasting = counts.forecasting
        self._intake, self._consistency = counts.intake, counts.consistency
        self._judge()

    def unlink(self) -> None:
        """Accept any stamp next, as after a pause of unknown length; the posterior stays."""
        self._last = self._last_stamp = None
        self._tracks.forget()
        self._forecasting.unlink()

    @property
    def _disagreements(self) -> tuple[Disagreement, ...]:
        """Reasons why the model does not fit, each of which withholds the estimate."""
        # seconds are refused for their misfit: one of both reasons says all
        return self._intake.disagreements or self._inconsistent

    def _judge(self) -> None:
        """Judge the fit of the last closed blocks."""
        self._inconsistent, unconfirmed = self._consistency.judge()
        doubt = self._intake.doubt(self._config.gate_probability)
        self._unconfirmed = doubt or unconfirmed or self._law_in_doubt
        self._fit = self._consistency.fits()
        self._unsound_fit = unsound_fit(self._fit)

    def _learn(self, screening: Screening) -> Update:
        """Answer an observation that passed the screening, by the model where it fits."""
        observation = screening.observation
        innovation, variance = self._forecasting.observed(
            observation.stamp_ns, observation.velocity, observation.velocity_sd, self._step_s
        )
        decision, model = self._advance(screening)
        forecast = self._forecasting.publish(model, disagrees=bool(self._disagreements))
        if forecast is None:
            return self._answer(observation.stamp_ns, decision)
        prediction = Prediction(
            valid=math.isfinite(forecast.velocity),
            horizon_s=self._step_s,
            velocity=forecast.velocity,
            variance=forecast.variance + forecast.noise,
            measured=observation.velocity,
            innovation=innovation,
            innovation_variance=variance,
        )
        return self._answer(observation.stamp_ns, decision, prediction)

    def _advance(self, screening: Screening) -> tuple[Decision, Forecast | None]:
        """Take an observation into the open second, or refuse it, with the model's forecast."""
        observation = screening.observation
        step_s, linked = link(observation.stamp_ns, self._last, self._step_s)
        torque = ground_torque(
            observation, self._last if linked else None, self._rover.wheel_inertia, step_s
        )
        if math.isnan(observation.sinkage[0]) and not all(map(math.isfinite, torque)):
            # the part that turns the wheel is unknown, and with it the torque on the ground
            detail = "a sinkage is missing, and a wheel rate, too: measure one of them"
            return without_rows(Outcome.NOT_FINITE, detail), None
        rates, body = bool(self._effects), self._body
        packed = pack(observation, torque, step_s, linked=linked, rates=rates, body=body)
        state = self._runtime.update(self._state, packed)
        report = self._runtime.report(state)
        refusal = self._refuse(observation, report) or (
            self._refuse_block(observation, report) if report.closed else None
        )
        if refusal is not None:
            return refusal, None
        before_s = self._intake.time_used_s
        settled = self._keep(observation, state, report)
        if report.closed:
            self._fade(report, self._intake.time_used_s - before_s)
        if report.closed or not linked:
            self._summarise()
        # no acceleration is known right after a gap
        forecast = Forecast(report.forecast, report.forecast_variance, observation.velocity_sd**2)
        accepted = self._deciding.accepted(screening, torque, report.distance, self._gate, settled)
        return accepted, forecast

    def _refuse(self, observation: Observation, report: Report) -> Decision | None:
        """Return the reason why the new state must not replace the old one; None where it may."""
        if is_failure(report):
            settled = self._discard_block()
            kept = "the posterior is kept, that second is left out" + self._contradict()
            detail = f"a number became infinite or NaN, or rounding ate the last second: {kept}"
            return without_rows(Outcome.NUMERICAL_FAILURE, detail, settled)
        if not all(report.usable):
            return self._deciding.out_of_range(report.usable)
        if report.distance > self._gate:
            self._intake.leave_out()
            self._judge()
            return self._deciding.gated(observation.velocity, report, self._gate)
        return None

    def _refuse_block(self, observation: Observation, report: Report) -> Decision | None:
        """Return the reason why the closed block is left out; a lasting contradiction re-opens."""
        self._change = min(report.changed, 1.0)  # rounding
        degrees = int(report.degrees)
        fit = SecondFit(report.misfit, degrees, report.single_misses, report.white_misses)
        seconds = self._step_s * (self._intake.waiting + 1)
        way = wheelbases(self._rover, observation.velocity, observation.yaw_rate, seconds)
        self._consistency.add(fit, self._change, way)
        self._judge()
        threshold = limit(self._config.gate_probability, degrees)
        taken = bool(report.misfit <= threshold)
        if taken:
            self._consistency.crossing.go(self._change, way)
            self._contradictions, self._doubt = 0, 0.0
            return None
        settled = self._discard_block()
        self._doubt = self._change
        detail = "the last second fits no ground that the model knows, and is left out: this"
        detail += f" observation and {settled} before it{self._contradict()}"
        self._summarise()
        return Decision(Outcome.GATED, (), report.misfit, threshold, degrees, detail, settled)

    def _contradict(self) -> str:
        """Count a second that is left out; after too many in a row, start over and return words."""
        self._contradictions += 1
        if self._contradictions < _PATIENCE:
            return ""
        self._reopen()
        self.reopened += 1
        return f"; after {_PATIENCE} of them the prior holds again"

    def _discard_block(self) -> int:
        """Leave out the open second; return its observations."""
        self._state = self._runtime.discard(self._state)
        self._last = None
        return self._intake.refuse()

    def _keep(self, observation: Observation, state: RuntimeState, report: Report) -> int:
        """Go on from the new state; return the observations that entered the posterior with it."""
        passed_s = 0.0
        if self._last is not None:
            passed_s = (observation.stamp_ns - self._last.stamp_ns) * 1e-9
        self._state, self._last = state, observation
        after_gap = report.closed and report.waiting > 0  # which ended the second before
        settled = self._intake.take() if after_gap else 0
        self._intake.wait(min(passed_s, LONGEST_GAP * self._step_s))
        return self._intake.take() if report.closed and not after_gap else settled

    def _fade(self, report: Report, passed_s: float) -> None:
        """Let all rows lose weight where the closed second tells the soil constants little."""
        there = np.isfinite(report.single_misses)
        if self._memory.needs(there, self._intake.time_used_s):
            self._state = self._memory.faded(self._runtime, self._state, passed_s)

    def _summarise(self) -> None:
        """Publish the present state from the next answer on."""
        unknown = self._consistency.crossing.unknown
        self._published = self._summary(self._state, self._doubt, unknown)

    def _summary(self, state: RuntimeState, doubt: float, unknown: float) -> Summary:
        """Return what a state says of the ground."""
        return summary_of(
            self._runtime.estimate(state),
            self._runtime.soils(state),
            self._beliefs,
            doubt,
            unknown,
            named(self._effects, self._runtime.effects(state)) if self._effects else (),
        )

    def _answer(
        self, stamp_ns: int, decision: Decision, prediction: Prediction | None = None
    ) -> Update:
        """Return the update; where a number must not be published, start over from the prior."""
        if prediction is None:
            self._forecasting.forget()
        update = self._update(stamp_ns, decision, prediction or NOTHING_PREDICTED)
        ground = "" if update.disagreements else self._published.unsound
        reason = ground or self._unsound_fit or unsound_answer(update.estimate, update.prediction)
        if reason:
            settled = max(self._intake.refuse(), decision.settled)
            self._reopen()
            self._consistency = Consistency(self._rows)
            self._judge()
            self.reopened += 1
            detail = f"{reason}: it is not published, and the prior holds again"
            failure = without_rows(Outcome.NUMERICAL_FAILURE, detail, settled)
            update = self._update(stamp_ns, failure, NOTHING_PREDICTED)
        self._sequence += 1
        return update

    def _update(self, stamp_ns: int, decision: Decision, prediction: Prediction) -> Update:
        intake, disagreements = self._intake, self._disagreements
        known = self._prior if disagreements else self._published.estimate
        sharp = any(known.identified)
        estimate = Estimate(
            mean=known.mean,
            covariance=known.covariance,
            lower_95=known.lower_95,
            upper_95=known.upper_95,
            identified=(False, False) if self._unconfirmed else known.identified,
            mass_below_zero=known.mass_below_zero,
            change_probability=0.0 if disagreements else self._change,
            soils=known.soils,
            soil_probability=known.soil_probability,
            effects=known.effects,
            observations_used=intake.used,
            observations_waiting=intake.waiting,
            time_used_s=intake.time_used_s,
            seconds=intake.seconds,
            fit=self._fit,
        )
        return Update(
            stamp_ns=stamp_ns,
            sequence=self._sequence,
            estimate=estimate,
            prediction=prediction,
            decision=decision,
            condition_number=self._published.condition,
            disagreements=disagreements,
            unconfirmed=self._unconfirmed if sharp else "",
        )


def _turning_body(model: LoadedModel) -> TurningBody | None:
    """Return what packing needs of a rover that turns; None where the model is by axle."""
    rover = model.rover
    body = TurningBody(rover.wheel_radius, rover.gravity, rover.centre_of_mass_x)
    return body if model.metadata.wheels else None
