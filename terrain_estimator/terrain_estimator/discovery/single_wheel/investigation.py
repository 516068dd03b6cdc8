# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The investigation of one wheel: fits, verdict, and errors on held-out cells."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from terrain_estimator.discovery.evidence.verdict import (
    Gains,
    Judgement,
    Thresholds,
    Verdict,
    is_pair,
    judge,
)
from terrain_estimator.discovery.hypotheses.library import (
    NOTHING,
    Hypothesis,
    LibraryEffect,
    together,
)
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.single_wheel.cells import ROWS, Cells, Rig, Row, cells_of
from terrain_estimator.discovery.single_wheel.fit import Explained, Floats, WheelModel, explain
from terrain_estimator.discovery.single_wheel.separation import separate_by
from terramechanics.effects import EFFECTS

FLOOR = 1.0
"""[deviations of repeatability] Root mean square error of a model that is true."""
FEWEST_HELD_OUT = 5
"""Different settings without which held-out ones prove nothing: replicates are not independent."""
MISFIT = 1e-3
"""[1] Probability of errors this large on held-out settings, below which the model is refuted."""
BY_RATE, BY_SLIP, SAME_SPEED = "rate_dependence", "slip_sinkage", 1.1
"""Ratio of carriage speeds within which slip and wheel rate vary together."""
_RESAMPLED = 2000
_SHOWN_BY = ROWS[:3]
"""Rows by which an effect is one of the ground: the torque has those of the drive, too."""


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Errors on F held-out cells, [F, R] in the order of ROWS; NaN without a measurement."""

    before: Floats
    after: Floats | None  # None where nothing is to be added
    settings: int  # different ones among them
    # squared distances of all errors, in deviations by repeatability and the free parameters;
    # chi-squared distributed with one degree of freedom a measurement where the model is true
    distances: tuple[float, ...]  # before, and after where there is one

    @property
    def measurements(self) -> int:
        """Number of held-out measurements."""
        return int(np.isfinite(self.before).sum())

    @property
    def described(self) -> bool:
        """Whether the errors are those of a model that is true, with the effect if one is added."""
        return bool(chi2.sf(self.distances[-1], max(self.measurements, 1)) >= MISFIT)

    def rms(self, repeatability: tuple[float, ...]) -> tuple[float, float | None]:
        """Return the errors before and after, in deviations of repeatability."""
        after = None if self.after is None else _rms(self.after / repeatability)
        return _rms(self.before / repeatability), after

    def improvement_95(
        self, repeatability: tuple[float, ...], seed: int
    ) -> tuple[float, float] | None:
        """Return the 95 % interval of before - after, cells resampled.

        None with fewer than FEWEST_HELD_OUT settings.
        """
        if self.after is None or self.settings < FEWEST_HELD_OUT:
            return None
        generator, count = np.random.default_rng(seed), len(self.before)
        drawn = generator.integers(count, size=(_RESAMPLED, count))
        before, after = (
            np.sqrt(np.nanmean(((each / repeatability) ** 2)[drawn], (1, 2)))
            for each in (self.before, self.after)
        )
        low, high = np.quantile(before - after, [0.025, 0.975])
        return float(low), float(high)


@dataclass(frozen=True, slots=True)
class WheelFinding:
    """The answer of some tables."""

    judgement: Judgement
    found: tuple[Explained, ...]  # the most probable first
    first: int  # number of the parameter of the first size
    nothing: Explained
    held_out: HeldOut
    proven: (
        bool | None
    )  # whether the best name helps on held-out settings; None where there are too few
    separate_by: str
    left: tuple[str, str]  # row and signal on which what the best name leaves depends most


def shown_by_one_wheel() -> tuple[str, ...]:
    """Return the effects that the rows of one wheel show.

    A bias of the sinkage is in the datum, which is unknown anyway.
    """
    return tuple(
        name
        for name, each in EFFECTS.items()
        if set(_SHOWN_BY) & set(each.rows) and name != "sinkage_bias"
    )


def of_one_wheel(names: Sequence[str]) -> list[Hypothesis]:
    """Return one hypothesis for each of the effects that one wheel shows."""
    return [Hypothesis((LibraryEffect(name),)) for name in names]


def investigate_wheel(
    bed: Rig,
    rows: Sequence[Row],
    reference: frozenset[str],
    given: Hypothesis,
    names: Sequence[str],
    thresholds: Thresholds,
    progress: ProgressCallback,
    *,
    by_trial: bool = False,
    seed: int = 0,
) -> WheelFinding:
    """Fit every named effect and pairs to all cells, judge, and hold cells out.

    Effects act outside of the tables of ``reference``; ``given`` ones act everywhere. Cells are
    held out one at a time, with all their replicates; or ``by_trial`` all cells of one trial, which
    shows how well it repeats and nothing about new settings.
    """
    cells = cells_of(rows, reference)
    hypotheses = of_one_wheel(names)
    model = WheelModel(bed, given, NOTHING)
    progress(0.0, "nothing missing")
    nothing = explain(model, cells)
    found = _searched(bed, given, cells, hypotheses, nothing)
    nothing = _better(nothing, explain(model, cells, start=found[0].values[: model.first]))
    free = explain(model, cells, flexible=True, start=nothing.values)
    gains, left = _weighed(bed, given, cells, found, nothing, free)
    if gains.explainable - gains.best >= thresholds.anything:
        progress(0.3, "pairs")
        best = found[0].hypothesis
        others = [together(best, each) for each in hypotheses if each != best]
        pairs = _searched(bed, given, cells, others, found[0])
        if pairs:
            paired, less = _weighed(bed, given, cells, pairs, nothing, free)
            if is_pair(gains, paired, thresholds):
                found, gains, left = (
                    [*pairs, *found],
                    dataclasses.replace(paired, single=gains.best),
                    less,
                )
    judgement = judge(gains, thresholds)
    probabilities = {
        name: 0.0 for each in hypotheses for name in each.names
    } | judgement.probabilities
    judgement = _by_design(dataclasses.replace(judgement, probabilities=probabilities), rows, found)
    confusable = judgement.named if judgement.verdict is Verdict.CONFUSABLE else ()
    judgement = by_probability(judgement)
    progress(0.6, "held-out cells")
    named = judgement.verdict in (Verdict.NAMED, Verdict.CONFUSABLE)
    errors = held_out(
        bed, rows, reference, [given, found[0].hypothesis if named else NOTHING], by_trial=by_trial
    )
    interval = errors.improvement_95(bed.repeatability, seed) if named else None
    proven = None if interval is None else interval[0] > 0.0
    if proven is False:
        judgement, confusable = _refuted(judgement), ()
    return WheelFinding(
        judgement, tuple(found), model.first, nothing, errors, proven, separate_by(confusable), left
    )


def lacking_in_reference(
    bed: Rig,
    rows: Sequence[Row],
    reference: frozenset[str],
    given: Hypothesis,
    names: Sequence[str],
    thresholds: Thresholds,
    progress: ProgressCallback,
    seed: int = 0,
) -> Hypothesis:
    """Return what the tables of ``reference`` show to be missing, which then acts in all tables.

    It cannot be the difference that is looked for. Only a name that is alone and proven counts:
    settings that are too few to hold one out say nothing.
    """
    own = [row for row in rows if row.table in reference]
    if len(cells_of(own).slip) < FEWEST_HELD_OUT:
        return NOTHING
    finding = investigate_wheel(
        bed, own, frozenset(), given, names, thresholds, progress, seed=seed
    )
    named = finding.judgement.verdict is Verdict.NAMED and finding.proven
    return finding.found[0].hypothesis if named else NOTHING


def _searched(
    bed: Rig, given: Hypothesis, cells: Cells, hypotheses: Sequence[Hypothesis], simpler: Explained
) -> list[Explained]:
    """Return fits of all, the most probable first.

    Each begins at the parameters of a ``simpler`` one, single effects at the nominal soil too.
    """
    found = []
    for model in (WheelModel(bed, given, each) for each in hypotheses):
        fitted = explain(
            model,
            cells,
            start=np.concatenate([simpler.values, model.start()[len(simpler.values) :]]),
        )
        found.append(
            fitted if simpler.hypothesis.effects else _better(fitted, explain(model, cells))
        )
    return sorted(found, key=lambda each: -each.log_evidence)


def _better(first: Explained, second: Explained) -> Explained:
    return first if first.log_evidence >= second.log_evidence else second


def _weighed(
    bed: Rig,
    given: Hypothesis,
    cells: Cells,
    found: Sequence[Explained],
    nothing: Explained,
    free: Explained,
) -> tuple[Gains, tuple[str, str]]:
    """Return the numbers of the rule, and the row and signal of the best fit's rest."""
    best, base = found[0], nothing.log_evidence
    best_with = explain(
        WheelModel(bed, given, best.hypothesis), cells, flexible=True, start=best.values
    )
    named = tuple((each.hypothesis, each.log_evidence - base) for each in found)
    return Gains(named, free.log_evidence - base, best_with.log_evidence - base), best_with.left


def _by_design(judgement: Judgement, rows: Sequence[Row], found: Sequence[Explained]) -> Judgement:
    """Add the rate law to a slip law, and the reverse, where the design does not separate them.

    At one speed of the carriage slip and wheel rate vary together.
    """
    speeds = [row.wheel_rate * (1.0 - row.slip) / math.cos(row.slip_angle) for row in rows]
    named = [name for each in judgement.named for name in each.names]
    there = {each.hypothesis.names: each.hypothesis for each in found}
    both = [there[name,] for name in (BY_SLIP, BY_RATE) if (name,) in there]
    varied = max(speeds) > SAME_SPEED * min(speeds)
    if (
        judgement.verdict is not Verdict.NAMED
        or named[0] not in (BY_SLIP, BY_RATE)
        or len(named) > 1
        or len(both) < 2
        or varied
    ):
        return judgement
    shared = 0.5 * (judgement.probabilities[BY_SLIP] + judgement.probabilities[BY_RATE])
    sets = tuple(sorted(both, key=lambda each: each != judgement.named[0]))
    return Judgement(
        Verdict.CONFUSABLE, sets, judgement.probabilities | {BY_SLIP: shared, BY_RATE: shared}
    )


def by_probability(judgement: Judgement) -> Judgement:
    """Return the judgement with the verdict none or unknown where that is most probable.

    A verdict that names effects while nothing missing is more probable than each of them would
    contradict its own table.
    """
    leader = max(judgement.probabilities, key=judgement.probabilities.__getitem__)
    if leader == "none":
        return dataclasses.replace(judgement, verdict=Verdict.NONE, named=())
    if leader == "unknown":
        return dataclasses.replace(judgement, verdict=Verdict.UNKNOWN, named=judgement.named[:1])
    return judgement


def _refuted(judgement: Judgement) -> Judgement:
    """Return the judgement without a name that does not help on held-out cells."""
    sure = {name: p for name, p in judgement.probabilities.items() if name in ("none", "unknown")}
    probabilities = (
        dict.fromkeys(judgement.probabilities, 0.0) | sure | {"unknown": 1.0 - sure["none"]}
    )
    return Judgement(Verdict.UNKNOWN, judgement.named[:1], probabilities)


def held_out(
    bed: Rig,
    rows: Sequence[Row],
    reference: frozenset[str],
    parts: Sequence[Hypothesis],
    *,
    by_trial: bool,
) -> HeldOut:
    """Return the errors of held-out cells, without the effect and with it.

    ``parts`` are the given effects and the effect.
    """
    given, sought = parts
    models = [
        WheelModel(bed, given, each)
        for each in ((NOTHING, sought) if sought.effects else (NOTHING,))
    ]
    errors: list[list[Floats]] = [[] for _ in models]
    distances = [0.0] * len(models)
    for left, out in _folds(rows, reference, by_trial=by_trial):
        for k, model in enumerate(models):
            values = explain(model, left).values
            error, distance = _missed(model, left, out, values)
            errors[k].append(error)
            distances[k] += distance
    before, *after = (np.concatenate(each) if each else np.zeros((0, len(ROWS))) for each in errors)
    settings = int(cells_of(rows, reference).acts.sum())
    return HeldOut(before, after[0] if after else None, settings, tuple(distances))


def _missed(model: WheelModel, left: Cells, out: Cells, values: Floats) -> tuple[Floats, float]:
    """Return the errors [F, R] of held-out cells, and their squared distance.

    The covariance is that of a true model: repeatability, and the parameters' uncertainty by
    repeatability (linearised). An excess that the fit needs is no part of it.
    """
    noise = np.array(model.bed.repeatability)

    def scaled(cells: Cells) -> tuple[Floats, Floats]:
        modelled, by = model.jacobian(cells, values)
        seen = cells.seen.numpy()
        error = (cells.measured.numpy() - modelled) / noise
        return error, (by / noise[:, None])[seen]

    _, fitted = scaled(left)
    error, slope = scaled(out)
    parameters = np.linalg.inv(fitted.T @ fitted + np.eye(fitted.shape[1]))
    short = error[out.seen.numpy()]
    covariance = np.eye(len(short)) + slope @ parameters @ slope.T
    return error * noise, float(short @ np.linalg.solve(covariance, short))


def _folds(
    rows: Sequence[Row], reference: frozenset[str], *, by_trial: bool
) -> list[tuple[Cells, Cells]]:
    """Return fitted and held-out cells, fold by fold."""
    if by_trial:
        divided = []
        for trial in sorted({row.trial for row in rows if row.table not in reference}):
            out = [row for row in rows if row.trial == trial and row.table not in reference]
            left = [row for row in rows if row not in out]
            divided.append((cells_of(left, reference), cells_of(out, reference)))
        return divided
    cells = cells_of(rows, reference)
    every = range(len(cells.slip))
    return [
        (cells.part([k for k in every if k != out]), cells.part([out]))
        for out in every
        if bool(cells.acts[out])
    ]


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if values.size else 0.0
