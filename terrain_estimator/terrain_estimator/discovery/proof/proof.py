# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The proof of an effect: predictions of unseen runs by the model with it and without it.

:mod:`terrain_estimator.discovery.proof.rule` says what they prove. Where nothing is to be added,
rollouts that are FAR off the noise floor refute "nothing is missing".
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from typing import Any

import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.fit import Fit
from terrain_estimator.discovery.evidence.study import Candidate, Study
from terrain_estimator.discovery.evidence.verdict import Judgement, Verdict
from terrain_estimator.discovery.hypotheses.contributions import Contributions, here
from terrain_estimator.discovery.hypotheses.equations import Equations, assembled
from terrain_estimator.discovery.hypotheses.library import NOTHING
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.discovery.proof.expected_factor import expected_factor
from terrain_estimator.discovery.proof.gap import Gap, gap_of
from terrain_estimator.discovery.proof.held_out import (
    GroundEstimate,
    Half,
    Model,
    equations_of,
    halved,
    long_enough,
)
from terrain_estimator.discovery.proof.one_step import names, one_step
from terrain_estimator.discovery.proof.rollout import (
    SimulatedSignals,
    Windows,
    simulated,
    windows_of,
)
from terrain_estimator.discovery.proof.rule import (
    DECISIVE,
    LEAST_CLOSED,
    is_proven,
    is_undecided,
    most_closed,
)
from terrain_estimator.discovery.proof.scores import Predicted, RowScore, joined, regions_of, scores
from terrain_estimator.discovery.proof.signals import compared
from terrain_estimator.discovery.proof.signals import names as signal_names
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.discovery.runs import PIECE, Blocks
from terrain_estimator.model.gaussian import cholesky
from terrain_estimator.model.packed_observation import BLOCK


@dataclass(frozen=True, slots=True)
class Strength:
    """c and tan phi of one half of a held-out run, before and after, with standard deviations."""

    run: str
    half: int
    cohesion_pa: tuple[float, float | None]
    cohesion_pa_sd: tuple[float, float | None]
    tan_phi: tuple[float, float | None]
    tan_phi_sd: tuple[float, float | None]


@dataclass(frozen=True, slots=True)
class SignalSeries:
    """One signal over five seconds of a held-out run, measured and simulated."""

    run: str
    signal: str
    unit: str
    time_s: tuple[float, ...]
    measured: tuple[float | None, ...]  # None where a wheel stands: slip is not defined
    before: tuple[float | None, ...]
    after: tuple[float | None, ...] | None


@dataclass(frozen=True, slots=True)
class Proof:
    """The result of the held-out runs for a model without (before) and with (after) an effect."""

    effect: str  # label of the hypothesis, empty where nothing is to be added
    added: bool
    gap: Gap | None  # of rollouts of five seconds; None: no turn is simulated ahead
    one_step_gap: Gap  # of predictions of one second, in what the model expects of its error
    log_bayes_factor: (
        float | None
    )  # [nat] of the held-out runs, the effect over nothing; None where nothing is to be added
    rows: tuple[RowScore, ...]
    parameters: tuple[Strength, ...]
    # in the window that the model without the effect misses most; the signal it misses most first
    rollouts: tuple[SignalSeries, ...]
    encoders: bool = True  # whether every run has measured wheel rates, which drive the rollouts
    # [nat] the log Bayes factor to expect, were the effect there; None where nothing is to be added
    expected_log_bayes_factor: float | None = None
    undecided: bool = False  # not added, and not refuted: these runs could not show the effect

    @property
    def sentence(self) -> str:
        """The outcome in words."""
        gap, step = self.gap or self.one_step_gap, self.one_step_gap.nll_improvement_95
        floor = f"sd of the sensors, the noise floor is {gap.noise_floor:.2f}"
        judged = "rollouts"
        if self.gap is None:
            judged = "predictions of one second"
            floor = f"sd of what is expected of them, the noise floor is {gap.noise_floor:.2f}"
        if gap.after is None or gap.improvement_95 is None or step is None:
            return f"nothing is added: {judged} of held-out runs miss by {gap.before:.2f} {floor}"
        most = most_closed(self.gap, self.one_step_gap)
        little = most is not None and most < LEAST_CLOSED
        outcome = "did not prove itself on held-out runs and is not added"
        if self.added:
            outcome = "is added"
        elif self.undecided:
            outcome = (
                "is neither proven nor refuted, as the held-out runs hardly show it"
                f" ({self.expected_log_bayes_factor:.0f} nat are to be expected of them,"
                f" {DECISIVE:.0f} would decide), and stands unproven: hold out others"
            )
        elif little:
            outcome = (
                f"closes at most {100.0 * max(most or 0.0, 0.0):.0f} % of the gap, a third is"
                " needed, and is not added"
            )
        better = (
            f"95 % interval of the improvement {gap.improvement_95[0]:.2f} to"
            f" {gap.improvement_95[1]:.2f}"
        )
        likelier = (
            f"one second ahead a value is {step[0]:.3f} to {step[1]:.3f} nat likelier, the runs as"
            f" a whole {self.log_bayes_factor:.0f} nat"
        )
        return (
            f"{self.effect} {outcome}: {judged} miss by {gap.after:.2f} instead of {gap.before:.2f}"
            f" {floor} ({better}); {likelier}"
        )

    def plain(self) -> dict[str, Any]:
        """Return its parts of finding.json."""
        gap = asdict(self.gap) if self.gap else dict.fromkeys(item.name for item in fields(Gap))
        return {"gap": gap, "proof": asdict(self) | {"sentence": self.sentence}}


@dataclass(frozen=True, slots=True)
class Judged:
    """The halves and evidences of a held-out run."""

    halves: tuple[Half, Half]
    evidences: list[float]  # [nat] of the whole run under each model
    expected: float  # [nat] of the last over the first, were the last one true


def judged_by(run: Blocks, models: tuple[Model, ...], *, nominal: Nominal) -> Judged:
    """Judge a held-out run by each model, which takes most of the time of a proof."""
    return Judged(halves(nominal, models, run), *_whole(nominal, models, run))


@torch.inference_mode()
def _whole(nominal: Nominal, models: tuple[Model, ...], run: Blocks) -> tuple[list[float], float]:
    """Return the log evidences of a whole run, and the log Bayes factor to expect of it."""
    fits = _fits(Study(nominal, [run]), models)
    given = [fit.given for fit in fits]
    if len(models) == 1:
        return given, 0.0
    return given, expected_factor(nominal, run, (models[0], models[-1]), (fits[0], fits[-1]))


@torch.inference_mode()
def halves(nominal: Nominal, models: tuple[Model, ...], run: Blocks) -> tuple[Half, Half]:
    """Return both halves of a held-out run; the same procedure for every model.

    Raises:
        RunError: see ``long_enough``.
    """
    parts = halved(long_enough(run))
    grounds = [_grounds(Study(nominal, [part]), models) for part in parts]
    return Half(parts[0], grounds[1]), Half(parts[1], grounds[0])


def _grounds(study: Study, models: tuple[Model, ...]) -> tuple[GroundEstimate, ...]:
    fits = _fits(study, models)
    return tuple(
        GroundEstimate(fit.point.runs[0], _covariance(fit.point.runs[0], fit.equations[0], model))
        for fit, model in zip(fits, models, strict=True)
    )


def _fits(study: Study, models: tuple[Model, ...]) -> list[Fit]:
    return [
        (study.given(model.hypothesis, model.values) if len(model.values) else study.nothing).fit
        for model in models
    ]


@torch.inference_mode()
def evidences(nominal: Nominal, models: tuple[Model, ...], run: Blocks) -> list[float]:
    """Return the log evidence [nat] of a held-out run under each model, up to a constant."""
    return [fit.given for fit in _fits(Study(nominal, [run]), models)]


def _covariance(unknowns: Unknowns, equations: Equations, model: Model) -> Tensor:
    """Return the covariance of a run's own unknowns but the velocities, then of the sizes.

    Misfit beyond the sensors' noise counts for nothing.
    """
    sizes = model.values.shape[0]
    weighted = torch.zeros_like(equations.residual).unsqueeze(-1)
    hessian, _ = assembled(
        equations.jacobian, cholesky(equations.covariance), weighted, equations.ends, sizes
    )
    _, precision = unknowns.prior_moments()
    size, own = precision.shape[0], 3 + unknowns.kappa.shape[0]
    covariance = torch.cholesky_inverse(cholesky(hessian[:size, :size] + torch.diag(precision)))
    parts = covariance[:own, :own], model.covariance
    return torch.block_diag(*parts)  # type: ignore[no-untyped-call]


def prove(
    nominal: Nominal,
    candidate: Candidate | None,
    runs: Sequence[Blocks],
    seed: int = 0,
    contributions: Contributions | None = None,
    nothing: Candidate | None = None,
) -> Proof:
    """Compare ``candidate``, fitted to other runs, with nothing on ``held_out`` runs.

    ``nothing`` is the fit of "nothing is missing" to those runs, which gives the constants of the
    rover that are in doubt; None where none is. ``seed`` of resampling, and of the terrains that
    the noise of the angles allows.

    Raises:
        RunError: a run is too short.
    """
    models = models_of(candidate, nothing)
    each_run = contributions or here(runs)
    runs_judged = each_run(partial(judged_by, nominal=nominal), [models] * len(runs))
    judged = [half for each in runs_judged for half in each.halves]
    likelier = sum(each.evidences[-1] - each.evidences[0] for each in runs_judged)
    regions = _joined(regions_of(runs))
    stepped = [_one_step(nominal, judged, number, model) for number, model in enumerate(models)]
    lengths = [len(half.blocks.packed) for half in judged]
    step_gap = gap_of(*_pair(stepped), lengths, seed)
    rows = scores("one_step", names(nominal.row_names), regions, *_pair(stepped))
    rolled = _rolled(nominal, judged, models, regions, seed) if nominal.places is None else NO_TURN
    expected = sum(each.expected for each in runs_judged) if candidate else None
    shown = rolled.gap, step_gap, likelier, expected
    return Proof(
        "" if candidate is None else candidate.hypothesis.label,
        is_proven(*shown),
        rolled.gap,
        step_gap,
        likelier if candidate else None,
        (*rows, *rolled.rows),
        tuple(_strength(half, number % 2) for number, half in enumerate(judged)),
        rolled.series,
        all(run.encoders for run in runs),
        expected,
        is_undecided(*shown),
    )


@dataclass(frozen=True, slots=True)
class Rolled:
    """What rollouts of five seconds tell of some models."""

    gap: Gap | None
    rows: tuple[RowScore, ...]
    series: tuple[SignalSeries, ...]


NO_TURN = Rolled(None, (), ())
"""What is told of rovers that turn, of which nothing is simulated ahead."""


def _rolled(
    nominal: Nominal,
    judged: Sequence[Half],
    models: Sequence[Model],
    regions: dict[str, Tensor],
    seed: int,
) -> Rolled:
    windows = windows_of(nominal, judged)
    driven = [
        simulated(nominal, judged, windows, number, model, seed)
        for number, model in enumerate(models)
    ]
    rolled = [
        compared(windows.measured, each.signals, each.changes, each.by_terrain) for each in driven
    ]
    pieces = [PIECE * int((windows.half == number).sum()) for number in range(len(judged))]
    seconds = _seconds(windows, [len(half.blocks.packed) for half in judged])
    axles = nominal.rover.axles
    rows = scores(
        "rollout",
        signal_names(axles),
        {name: here[seconds] for name, here in regions.items()},
        *_pair(rolled),
    )
    gap = gap_of(*_pair(rolled), pieces, seed)
    return Rolled(gap, tuple(rows), _series(axles, judged, windows, driven, rolled[0]))


def models_of(candidate: Candidate | None, nothing: Candidate | None = None) -> tuple[Model, ...]:
    """Return the model without an effect, and behind it that with the candidate's.

    The first one has the rover's constants of the fit ``nothing``, None: those of the file.
    """
    none = torch.zeros(0, dtype=torch.float64)
    models = (Model(NOTHING, none, none.view(0, 0)) if nothing is None else _fitted(nothing),)
    return models if candidate is None else (*models, _fitted(candidate))


def _fitted(candidate: Candidate) -> Model:
    fit = candidate.fit
    return Model(candidate.hypothesis, fit.point.shared, fit.covariance)


def settled(finding: Finding, proof: Proof | None) -> Finding:
    """Return the finding with the held-out runs counted.

    A name that did not prove itself there is no longer the answer: its probability goes to
    "unknown", and it stays the closest candidate. "Nothing is missing" is no answer either where
    rollouts by measured wheel rates are far off; no effect is then the closest. Without held-out
    runs (None), and where they are undecided, the verdict stands unproven.
    """
    judgement = finding.judgement
    if proof is None:
        return finding
    clear = judgement.verdict in (Verdict.NONE, Verdict.SOIL)
    if clear and proof.encoders and proof.gap is not None and proof.gap.far_off:
        sure = str(judgement.verdict)
        others = {name: p for name, p in judgement.probabilities.items() if name != sure}
        rest = sum(p for name, p in others.items() if name != "unknown")
        surprised = Judgement(Verdict.UNKNOWN, (), others | {sure: 0.0, "unknown": 1.0 - rest})
        return replace(finding, judgement=surprised)
    stands = proof.added or proof.undecided
    if stands or judgement.verdict not in (Verdict.NAMED, Verdict.CONFUSABLE):
        return finding
    none = {name: p for name, p in judgement.probabilities.items() if name in ("none", "soil")}
    refuted = dict.fromkeys(judgement.probabilities, 0.0) | none
    refuted["unknown"] = 1.0 - sum(none.values())
    unknown = Judgement(Verdict.UNKNOWN, judgement.named[:1], refuted)
    return replace(finding, judgement=unknown)


def _pair(each: Sequence[Predicted]) -> tuple[Predicted, Predicted | None]:
    return each[0], each[1] if len(each) > 1 else None


def _one_step(nominal: Nominal, judged: Sequence[Half], number: int, model: Model) -> Predicted:
    return joined(
        [
            one_step(
                equations_of(nominal, half, number, model),
                half.grounds[number],
                half.blocks.follows(),
            )
            for half in judged
        ]
    )


def _joined(regions: Sequence[dict[str, Tensor]]) -> dict[str, Tensor]:
    return {name: torch.cat([each[name] for each in regions]) for name in regions[0]}


def _seconds(windows: Windows, lengths: Sequence[int]) -> Tensor:
    """Return the number of every second of all windows among the blocks of halves, [W PIECE]."""
    before = torch.cumsum(torch.tensor([0, *lengths[:-1]]), 0)
    return ((before[windows.half] + windows.first).unsqueeze(1) + torch.arange(PIECE)).flatten()


def _strength(half: Half, number: int) -> Strength:
    means = [ground.unknowns.theta.tolist() for ground in half.grounds]
    spreads = [ground.covariance.diagonal()[:2].sqrt().tolist() for ground in half.grounds]

    def pair(table: list[list[float]], index: int, unit: float) -> tuple[float, float | None]:
        return unit * table[0][index], unit * table[1][index] if len(table) > 1 else None

    columns = [
        pair(table, index, unit)
        for index, unit in ((0, 1000.0), (1, 1.0))
        for table in (means, spreads)
    ]
    # The ground that judges a half is that of the other half.
    return Strength(half.blocks.name, 1 - number, *columns)


def _series(
    axles: int,
    judged: Sequence[Half],
    windows: Windows,
    driven: Sequence[SimulatedSignals],
    before: Predicted,
) -> tuple[SignalSeries, ...]:
    """Return every measured signal of the worst window, that which is missed most first."""
    window = int(before.misfit.view(-1, PIECE).sum(1).argmax())
    there = (before.error / before.sd).view(-1, PIECE, before.error.shape[-1])[window]
    missed = there.square().nanmean(0).nan_to_num(-1.0)
    half = judged[int(windows.half[window])].blocks
    start = float(half.signals.time[int(windows.first[window]), 0])
    time = start + windows.step * (torch.arange(1, PIECE * BLOCK) - 0.5 * (BLOCK - 1))

    def of(k: int) -> SignalSeries:
        columns = [
            windows.measured.values[window, :, k],
            *(each.signals[window, :, k] for each in driven),
        ]
        measured, first, *second = (
            tuple(x if math.isfinite(x) else None for x in column.tolist()) for column in columns
        )
        return SignalSeries(
            half.name,
            *signal_names(axles)[k],
            tuple(time.tolist()),
            measured,
            first,
            second[0] if second else None,
        )

    every = (of(k) for k in missed.argsort(descending=True, stable=True).tolist())
    return tuple(each for each in every if any(value is not None for value in each.measured))
