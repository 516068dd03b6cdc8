# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The investigation of one wheel: fits, verdict, and errors on held-out cells."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.stats import chi2

from terrain_estimator.discovery.evidence.verdict import Judgement, Verdict
from terrain_estimator.discovery.hypotheses.library import (
    NOTHING,
    Hypothesis,
    LibraryEffect,
    together,
)
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.single_wheel.cells import ROWS, Cells, Rig, Row, cells_of
from terrain_estimator.discovery.single_wheel.families import (
    NAME,
    Family,
    Weighed,
    families,
    judge,
)
from terrain_estimator.discovery.single_wheel.fit import Explained, Floats, WheelModel, explain
from terrain_estimator.discovery.single_wheel.separation import separate_by
from terramechanics.effects import EFFECTS, describe

FLOOR = 1.0
"""[deviations of the rig] Root mean square error of a model that is true."""
FEWEST_HELD_OUT = 5
"""Different settings without which held-out ones prove nothing: replicates are not independent."""
MISFIT = 1e-3
"""[1] Probability of errors this large on held-out settings, below which the model is refuted."""
BY_RATE, BY_SLIP, SAME_SPEED = "rate_dependence", "slip_sinkage", 1.1
"""Ratio of carriage speeds within which slip and wheel rate vary together."""
LOOSE = 0.5
"""[1] Least relative deviation of soil constants in the search for a name.

Constants of plates and shear boxes need not be those of a wheel: that they are not is no effect.
"""
HOPELESS = -3.0
"""[nat] Gain of a family's first law below which no other law of it is fitted."""
_RESAMPLED = 2000
NO_ODDS: Mapping[str, float] = MappingProxyType({})
"""All names have equal prior odds."""
_SHOWN_BY = ROWS[:3]
"""Rows by which an effect is one of the ground: the torque has those of the drive, too."""


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Errors on F held-out cells, [F, R] in the order of ROWS; NaN without a measurement."""

    before: Floats
    after: Floats | None  # None where nothing is to be added
    settings: int  # different ones among them
    slip: Floats  # [F]
    load: Floats  # [F] [N]
    measured: Floats  # [F, R]
    # squared distances of all errors, in deviations of the rig and the free parameters;
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

    def rms(self, deviations: tuple[float, ...]) -> tuple[float, float | None]:
        """Return the errors before and after, in deviations of the rig."""
        after = None if self.after is None else _rms(self.after / deviations)
        return _rms(self.before / deviations), after

    def improvement_95(
        self, deviations: tuple[float, ...], seed: int
    ) -> tuple[float, float] | None:
        """Return the 95 % interval of before - after, cells resampled.

        None with fewer than FEWEST_HELD_OUT settings.
        """
        if self.after is None or self.settings < FEWEST_HELD_OUT:
            return None
        generator, count = np.random.default_rng(seed), len(self.before)
        drawn = generator.integers(count, size=(_RESAMPLED, count))
        before, after = (
            np.sqrt(np.nanmean(((each / deviations) ** 2)[drawn], (1, 2)))
            for each in (self.before, self.after)
        )
        low, high = np.quantile(before - after, [0.025, 0.975])
        return float(low), float(high)


@dataclass(frozen=True, slots=True)
class WheelFinding:
    """The answer of some tables."""

    judgement: Judgement
    weighed: Weighed
    bed: Rig  # with the soil constants as loose as the search takes them
    nothing: Explained
    held_out: HeldOut
    proven: (
        bool | None
    )  # whether the best name helps on held-out settings; None where there are too few
    separate_by: str
    left: tuple[str, str]  # row and signal on which what the best name leaves depends most

    @property
    def first(self) -> int:
        """Number of the parameter of the first size."""
        return len(self.nothing.values)

    @property
    def added(self) -> Hypothesis:
        """The effect that is named, the first of several; nothing where none is."""
        named = self.judgement.verdict in (Verdict.NAMED, Verdict.CONFUSABLE)
        return self.judgement.named[0] if named else NOTHING

    def family(self, hypothesis: Hypothesis) -> Family:
        """Return the family of a hypothesis that was named."""
        return next(each for each in self.weighed.families if each.names == hypothesis.names)


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
    return [Hypothesis((LibraryEffect(name, one_wheel=True),)) for name in names]


def investigate_wheel(
    bed: Rig,
    rows: Sequence[Row],
    reference: frozenset[str],
    given: Hypothesis,
    names: Sequence[str],
    progress: ProgressCallback,
    *,
    odds: Mapping[str, float] = NO_ODDS,
    by_trial: bool = False,
    seed: int = 0,
) -> WheelFinding:
    """Fit every law of the named effects and pairs to all cells, judge, and hold cells out.

    Effects act outside of the tables of ``reference``; ``given`` ones act everywhere. ``odds`` are
    prior odds of names over what is usual. Cells are held out one at a time, with all their
    replicates; or ``by_trial`` all cells of one trial, which shows how well it repeats and nothing
    about new settings.
    """
    bed = loosened(bed)
    progress(0.0, "laws")
    nothing, weighed, best = weigh(bed, given, cells_of(rows, reference), names)
    judgement = judge_rows(weighed, rows, names, odds)
    confusable = judgement.named if judgement.verdict is Verdict.CONFUSABLE else ()
    progress(0.6, "held-out cells")
    named = judgement.verdict in (Verdict.NAMED, Verdict.CONFUSABLE)
    errors = held_out(
        bed, rows, reference, [given, judgement.named[0] if named else NOTHING], by_trial=by_trial
    )
    interval = errors.improvement_95(bed.deviations, seed) if named else None
    proven = None if interval is None else interval[0] > 0.0
    if proven is False:
        judgement, confusable = _refuted(judgement), ()
    return WheelFinding(
        judgement,
        weighed,
        bed,
        nothing,
        errors,
        proven,
        separate_by(confusable),
        best.left,
    )


def judge_rows(
    weighed: Weighed, rows: Sequence[Row], names: Sequence[str], odds: Mapping[str, float] = NO_ODDS
) -> Judgement:
    """Return the judgement before any setting is held out, with all ``names`` in its table."""
    judgement = judge(weighed, odds)
    missing = {name: 0.0 for name in names if name not in judgement.probabilities}
    judgement = dataclasses.replace(judgement, probabilities=missing | judgement.probabilities)
    return _by_design(judgement, rows, weighed)


def loosened(bed: Rig) -> Rig:
    """Return the testbed with soil constants no better known than LOOSE."""
    return dataclasses.replace(bed, constants_sd=tuple(max(LOOSE, sd) for sd in bed.constants_sd))


def weigh(
    bed: Rig, given: Hypothesis, cells: Cells, names: Sequence[str]
) -> tuple[Explained, Weighed, Explained]:
    """Fit all laws, and pairs where one effect does not do.

    Returns the fit of nothing, all evidences, and the best law's fit.
    """
    alone = explain(WheelModel(bed, given, NOTHING), cells)
    nothing = explain(WheelModel(bed, given, NOTHING), cells, flexible=True, start=alone.values)
    fitted = _searched(bed, given, cells, of_one_wheel(names), nothing)
    base = max(nothing.log_evidence, alone.log_evidence)
    for each in tuple(fitted):
        if each.log_evidence - base > HOPELESS:
            others = competing(each.hypothesis)
            fitted += _searched(bed, given, cells, others, nothing)
    found = families(fitted)
    best = found[0].laws[0]
    if found[0].log_evidence - base >= NAME:
        bare = explain(WheelModel(bed, given, best.hypothesis), cells, start=best.values)
        if best.log_evidence - bare.log_evidence >= NAME:
            second = [each for each in of_one_wheel(names) if each.names != best.hypothesis.names]
            pairs = [together(best.hypothesis, each) for each in second]
            paired = families(_searched(bed, given, cells, pairs, best))
            # a second effect is named where it gains as much as a first one has to
            found += [pair for pair in paired if pair.log_evidence >= found[0].log_evidence + NAME]
            found.sort(key=lambda each: -each.log_evidence)
    weighed = Weighed(alone.log_evidence, nothing.log_evidence, tuple(found))
    return nothing, weighed, found[0].laws[0]


def competing(hypothesis: Hypothesis) -> list[Hypothesis]:
    """Return the other laws of the one effect of a hypothesis."""
    effect = hypothesis.effects[0]
    count = len(describe(effect.name).competing)
    return [Hypothesis((dataclasses.replace(effect, competing=k),)) for k in range(count)]


def lacking_in_reference(
    bed: Rig,
    rows: Sequence[Row],
    reference: frozenset[str],
    given: Hypothesis,
    names: Sequence[str],
    progress: ProgressCallback,
    seed: int = 0,
) -> Hypothesis:
    """Return what the tables of ``reference`` show to be missing, which then acts in all tables.

    It cannot be the difference that is looked for. Only a name that is alone and proven counts:
    settings that are too few to hold one out say nothing.
    """
    own = [row for row in rows if row.table in reference]
    cells = cells_of(own)
    if len(cells.slip) < FEWEST_HELD_OUT:
        return NOTHING
    progress(0.0, "laws")
    _, weighed, _ = weigh(loosened(bed), given, cells, names)
    if judge_rows(weighed, own, names).verdict is not Verdict.NAMED:
        return NOTHING
    finding = investigate_wheel(bed, own, frozenset(), given, names, progress, seed=seed)
    named = finding.judgement.verdict is Verdict.NAMED and finding.proven
    return finding.added if named else NOTHING


def _searched(
    bed: Rig, given: Hypothesis, cells: Cells, hypotheses: Sequence[Hypothesis], simpler: Explained
) -> list[Explained]:
    """Return fits of all with a model error, from the parameters of a ``simpler`` one."""
    found = []
    for model in (WheelModel(bed, given, each) for each in hypotheses):
        start = np.concatenate([simpler.values, model.start()[len(simpler.values) :]])
        found.append(explain(model, cells, flexible=True, start=start))
    return found


def _by_design(judgement: Judgement, rows: Sequence[Row], weighed: Weighed) -> Judgement:
    """Add the rate law to a slip law, and the reverse, where the design does not separate them.

    At one speed of the carriage slip and wheel rate vary together.
    """
    speeds = [row.wheel_rate * (1.0 - row.slip) / math.cos(row.slip_angle) for row in rows]
    named = [name for each in judgement.named for name in each.names]
    there = {each.names: each.laws[0].hypothesis for each in weighed.families}
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
    folds = _folds(rows, reference, by_trial=by_trial)
    for left, out in folds:
        for k, model in enumerate(models):
            values = explain(model, left).values
            error, distance = _missed(model, left, out, values)
            errors[k].append(error)
            distances[k] += distance
    before, *after = (np.concatenate(each) if each else np.zeros((0, len(ROWS))) for each in errors)
    slip, load, measured = (
        np.concatenate([getattr(out, name).numpy() for _, out in folds])
        for name in ("slip", "load", "measured")
    )
    settings = int(cells_of(rows, reference).acts.sum())
    return HeldOut(
        before, after[0] if after else None, settings, slip, load, measured, tuple(distances)
    )


def _missed(model: WheelModel, left: Cells, out: Cells, values: Floats) -> tuple[Floats, float]:
    """Return the errors [F, R] of held-out cells, and their squared distance.

    The covariance is that of a true model: repeatability and errors of reading, that of slip
    included, and what they leave uncertain of the parameters (linearised). An excess that the fit
    needs is no part of it.
    """
    noise = np.array(model.bed.deviations)

    def scaled(cells: Cells) -> tuple[Floats, Floats, Floats]:
        modelled, by = model.jacobian(cells, values)
        seen = cells.seen.numpy()
        error = (cells.measured.numpy() - modelled) / noise
        covariance = np.eye(seen.size) + model.slip_errors(cells, values)
        every = seen.ravel()
        return error, (by / noise[:, None])[seen], covariance[np.ix_(every, every)]

    _, fitted, known = scaled(left)
    error, slope, covariance = scaled(out)
    information = fitted.T @ np.linalg.solve(known, fitted)
    parameters = np.linalg.inv(information + np.eye(fitted.shape[1]))
    short = error[out.seen.numpy()]
    covariance += slope @ parameters @ slope.T
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
