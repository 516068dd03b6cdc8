# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""One search for the effect that foreign drives of a soil and law show, and its proof.

The rule for the drives, fixed before any search: HELD_OUT is held out where the group has it, all
others are searched. A group without it has no proof.
"""

import time
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import torch

from studies.foreign.drives import observations_of
from studies.foreign.logs import log_names, measured_columns, read_log
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.discovery.answer import Question, answered
from terrain_estimator.discovery.evidence.study import Study
from terrain_estimator.discovery.hypotheses.library import singles
from terrain_estimator.discovery.hypotheses.rows import Nominal, nominal_of
from terrain_estimator.discovery.proof.scores import RowScore
from terrain_estimator.discovery.proof.soil_proof import Proven
from terrain_estimator.discovery.runs import Blocks, Refusals, cut, run_of
from terrain_estimator.learning.finding_model import prior_of
from terramechanics.presets import load_rover, load_soil, soil_names

HELD_OUT = "slopes"
"""The drive that is held out, of each soil and law."""
SOIL = "loose_sand"
"""What the search is told of the soil: n, k_c, k_phi and K are those of the drives."""
MODEL = "mars_rover"
"""The installed model whose prior the search takes, as the command does."""
DEFAULT, LAW = "default", "contact_law_scm"
LIBRARIES: dict[str, tuple[str, ...]] = {DEFAULT: (), LAW: (LAW,)}
"""Candidates of a search: those of the command without ``--library``, and the law alone."""


@dataclass(frozen=True, slots=True)
class Signal:
    """Errors of rollouts of one signal, root mean square over all held-out seconds."""

    name: str
    unit: str
    before: float
    after: float
    floor: float

    @property
    def closed(self) -> float | None:
        """Share of the gap that is closed; None where there is none."""
        gap = self.before - self.floor
        return (self.before - self.after) / gap if gap > 0.0 else None


@dataclass(frozen=True, slots=True)
class Searched:
    """What one search found of a group of drives."""

    group: str  # SOIL_LAW
    library: str
    verdict: str
    named: str  # label of the answer, or the closest; with its sizes
    drives: tuple[str, ...]  # searched
    truth: tuple[float, float]  # c [Pa] and tan phi of all of them
    before: tuple[tuple[float, float], ...]  # c, tan phi of each drive, nothing missing
    after: tuple[tuple[float, float], ...]  # with the best name
    rollout: tuple[float, float, float] | None  # before, after, floor [sd of the sensors]
    closed: tuple[float, float, float] | None  # share with 95 % limits
    ahead: tuple[float, float] | None  # next second, before and after
    signals: tuple[Signal, ...]
    seconds: float  # processor time


def groups() -> list[tuple[str, str]]:
    """Return the soils and laws of the logs. Raises FileNotFoundError where there are no logs."""
    names = [name.split("_") for name in log_names()]
    if not names:
        raise FileNotFoundError(
            "no drives in bags/foreign/logs: they come with the repository, not with an installed"
            " package; run this in a whole checkout"
        )
    return sorted({(soil, law) for soil, _, law in names})


def searched(soil: str, law: str, library: str, seed: int) -> Searched:
    """Search the drives of a soil and law for what is missing, as find_missing_effect does."""
    torch.set_num_threads(1)
    start, rover = time.process_time(), load_rover("mars_rover")
    nominal = nominal_of(rover, load_soil(SOIL), prior_of(MODEL))
    names = [name for name in log_names() if name.startswith(f"{soil}_") and name.endswith(law)]
    kept = [name for name in names if name.split("_")[1] == HELD_OUT]
    used = [name for name in names if name not in kept]
    with torch.inference_mode():
        study = Study(nominal, [_blocks(name, nominal, seed) for name in used])
        question = Question(
            singles(LIBRARIES[library], rover.axles),
            [load_soil(name) for name in soil_names() if name != SOIL],
            [_blocks(name, nominal, seed) for name in kept],
            seed,
            on_request=library == DEFAULT,
        )
        outcome = answered(study, question, _silent).outcome
    truth = read_log(used[0]).truth
    return _told(f"{soil}_{law}", library, used, (float(truth[0]), float(truth[1])), outcome, start)


@cache
def _measured(name: str, seed: int) -> list:  # type: ignore[type-arg]
    log = read_log(name)
    return observations_of(measured_columns(log, seed), log.rover)


def _blocks(name: str, nominal: Nominal, seed: int) -> Blocks:
    observations = _measured(name, seed)
    run = run_of(name, observations, nominal.rover, CoreConfig(), Refusals())
    return replace(cut(run, nominal.contact), soil=nominal.soil)


def _told(
    group: str,
    library: str,
    drives: list[str],
    truth: tuple[float, float],
    outcome: Proven,
    start: float,
) -> Searched:
    finding, proof = outcome.finding, outcome.proof
    sizes = ", ".join(f"{name} {size:.2f} +- {sd:.2f}" for name, size, sd in finding.best.sizes)
    grounds = [
        tuple((1e3 * float(run.theta[0]), float(run.theta[1])) for run in candidate.fit.point.runs)
        for candidate in (finding.nothing, finding.best)
    ]
    gap = proof.gap if proof and proof.gap and proof.gap.after is not None else None
    step = proof.one_step_gap if proof else None
    return Searched(  # type: ignore[call-arg]
        group,
        library,
        str(finding.judgement.verdict),
        sizes,
        tuple(name.split("_")[1] for name in drives),
        truth,
        *grounds,  # type: ignore[arg-type]
        (gap.before, float(gap.after or 0.0), gap.noise_floor) if gap else None,
        (float(gap.closed), *gap.closed_95) if gap and gap.closed and gap.closed_95 else None,
        (step.before, float(step.after)) if step and step.after is not None else None,
        tuple(_signals(proof.rows)) if gap and proof else (),
        time.process_time() - start,
    )


def _signals(rows: tuple[RowScore, ...]) -> list[Signal]:
    return [
        Signal(row.row, row.unit, row.error[0], row.error[1], row.noise_floor)
        for row in rows
        if row.kind == "rollout" and row.region == "everywhere" and row.error[1] is not None
    ]


def errors(found: Searched) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the median relative errors of c and tan phi over the drives, before and after."""
    before, after = (
        np.median(np.abs(np.array(each) / np.array(found.truth) - 1.0), 0)
        for each in (found.before, found.after)
    )
    return (float(before[0]), float(before[1])), (float(after[0]), float(after[1]))


def _silent(share: float, note: str) -> None:
    del share, note
