# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Signals that no run has, and what each would tell apart.

The runs are looked at again with the signal filled in, as the fit predicts it and with the noise of
usual sensors. Its rows then hold, and the expected log Bayes factors between the effects in doubt
follow as they do for the rows that are there (``expected``).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import permutations

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.expected import Stage, loss, stage
from terrain_estimator.discovery.evidence.isolability import (
    LEAST,
    Signature,
    between,
    run_signatures,
    signatures,
    stages_of,
    table,
)
from terrain_estimator.discovery.evidence.study import Candidate, Study
from terrain_estimator.discovery.hypotheses.doubted_rows import rows_of
from terrain_estimator.discovery.hypotheses.equations import Equations, Query, RunEquations
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.hypotheses.rows import (
    Expansion,
    LinearizationPoint,
    Nominal,
)
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.discovery.runs import Blocks, RecordedRun
from terrain_estimator.model.packing import (
    view_of,
    with_acceleration_and_sd,
    with_bogie_angle,
    with_torque_and_sd,
)
from terramechanics.simulation.sensors import Noise
from terramechanics.vehicle.rover import Rover

BOGIE_ANGLE, TORQUE, ACCELERATION = SIGNALS = ("bogie angle", "motor torque", "acceleration")


@dataclass(frozen=True, slots=True)
class MissingSignal:
    """A signal that no run has, and the pair of effects that it would separate least."""

    name: str
    nats: float  # expected log Bayes factor of the first of the pair over the second, with it
    without: float  # [nat] the same for the runs as they are
    pair: tuple[str, str]
    separates: bool  # every pair, so that the verdict would name one effect


def lacking(runs: Sequence[Blocks]) -> tuple[str, ...]:
    """Return the signals of which no run has a value."""

    def measured(run: Blocks) -> tuple[bool, ...]:
        view = view_of(run.packed, run.wheel_rate.shape[-1])
        values = (view.bogie_angle, view.torque, view.acceleration)
        return tuple(bool(torch.isfinite(each).any()) for each in values)

    there = [measured(run) for run in runs]
    return tuple(
        name for name, each in zip(SIGNALS, zip(*there, strict=True), strict=True) if not any(each)
    )


def without_signals(run: RecordedRun, signals: Sequence[str], axles: int) -> RecordedRun:
    """Return a run in which these signals are not measured."""
    packed, nothing = run.packed, torch.full_like(run.packed[:, 0], math.nan)
    wheels = nothing.unsqueeze(1).expand(-1, axles)
    if BOGIE_ANGLE in signals:
        packed = with_bogie_angle(packed, nothing, axles)
    if TORQUE in signals:
        packed = with_torque_and_sd(packed, wheels, wheels)
    if ACCELERATION in signals:
        packed = with_acceleration_and_sd(packed, nothing, nothing, axles)
    return replace(run, packed=packed)


def with_signal(run: Blocks, signal: str, rover: Rover, torque: Tensor) -> Blocks:
    """Return a run in which a signal is measured; ``torque`` [n, A] [N m] is that of the fit.

    A bogie on even ground has the mean slope of its wheels; a rover without a joint lacks no angle
    of one. What an accelerometer shows of changes
    of speed does not matter here.
    """
    packed, axles, noise = run.packed, rover.axles, Noise()
    view = view_of(packed, axles)
    if signal == BOGIE_ANGLE:
        (joint,) = rover.suspension
        slope = view.contact_angle[..., joint.axles].mean(-1)
        return replace(run, packed=with_bogie_angle(packed, slope, axles))
    if signal == ACCELERATION:
        felt = rover.gravity * torch.sin(view.pitch)
        spread = torch.full_like(felt, noise.acceleration)
        return replace(run, packed=with_acceleration_and_sd(packed, felt, spread, axles))
    values = torque.view(view.torque.shape)
    load = 0.3 * rover.wheel_radius * rover.weight / len(rover.wheels)
    spread = torch.hypot(
        noise.torque_relative * values, torch.full_like(values, noise.torque_of_load * load)
    )
    return replace(run, packed=with_torque_and_sd(packed, values, spread))


def missing_signals(
    study: Study, doubtful: Sequence[Hypothesis], around: Candidate, apart: float
) -> list[MissingSignal]:
    """Return the signals that no run has, that which separates most first.

    A signal separates effects where it adds LEAST to every pair, and each is then worse than the
    other by the share ``apart`` of what that gains over nothing. Ground and noise are those of
    ``around``. None with fewer than two effects in doubt.
    """
    absent = lacking(study.runs)
    if len(doubtful) < 2 or not absent:
        return []
    pairs = list(permutations(range(len(doubtful)), 2))
    stages, known = stages_of(around), signatures(study, doubtful, around)
    now = {pair: between(stages, known[pair[0]], known[pair[1]]) for pair in pairs}
    found = []
    for name in absent:
        stages, known = _with(study, name, doubtful, around)
        alone = [loss(stages, table(each, []), None).nats for each in known]
        then = {pair: between(stages, known[pair[0]], known[pair[1]]) for pair in pairs}
        worst = min(then, key=lambda pair: then[pair])
        found.append(
            MissingSignal(
                name,
                then[worst],
                now[worst],
                (doubtful[worst[0]].label, doubtful[worst[1]].label),
                all(
                    nats > max(apart * alone[pair[0]], now[pair] + LEAST)
                    for pair, nats in then.items()
                ),
            )
        )
    return sorted(found, key=lambda each: -each.nats)


def _with(
    study: Study, signal: str, doubtful: Sequence[Hypothesis], around: Candidate
) -> tuple[list[Stage], list[Signature]]:
    """Return the rows of all runs with that signal, and the effects' signatures in them."""
    of_run = partial(
        _of_run_with,
        signal=signal,
        nominal=study.nominal,
        mask=study.mask,
        hypothesis=around.hypothesis,
        shared_values=around.fit.point.shared,
        doubtful=tuple(doubtful),
        runs=len(study.runs),
    )
    fitted = list(zip(around.fit.point.runs, around.fit.equations, strict=True))
    every = study.contributions(of_run, fitted)
    marks = zip(*(each for _, each in every), strict=True)
    return [each for each, _ in every], [reduce(Signature.joined, each) for each in marks]


def _of_run_with(
    run: Blocks,
    fitted: tuple[Unknowns, Equations],
    *,
    signal: str,
    nominal: Nominal,
    mask: Tensor,
    hypothesis: Hypothesis,
    shared_values: Tensor,
    doubtful: Sequence[Hypothesis],
    runs: int,
) -> tuple[Stage, list[Signature]]:
    """Return the rows of one run with that signal, and the effects' signatures in it."""
    unknowns, before = fitted
    steps = hypothesis.shared().step
    values = tuple(shared_values[: len(steps)].tolist())
    place = Expansion(torch.nan_to_num(before.around.input_correction), before.around.doubt)
    point = LinearizationPoint(unknowns.theta, unknowns.kappa, values)

    rows = rows_of(nominal, run, hypothesis).rows(point, place)
    theta = torch.cat([unknowns.theta, torch.ones_like(unknowns.theta[:1])])
    torque = (rows.features[0] @ theta)[:, 2 : 2 + nominal.rover.axles]
    filled = with_signal(run, signal, nominal.rover, torque)
    columns = torch.zeros(len(run.packed), len(mask) + 1, 0, dtype=torch.float64)
    none = torch.zeros(0, dtype=torch.float64)
    query = Query(unknowns, values, none, columns, steps, None, place)
    equations = RunEquations(filled, rows_of(nominal, filled, hypothesis), mask).at(query)
    marks = run_signatures(nominal, filled, mask, doubtful, unknowns, place)
    there = stage(equations, unknowns, before.excess, len(hypothesis.doubt), runs)
    return there, marks
