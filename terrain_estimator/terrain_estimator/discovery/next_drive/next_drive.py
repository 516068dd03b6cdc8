# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The short drive that would separate the effects in doubt best, by expected information.

Each manoeuvre is simulated with each effect in doubt acting at its typical size, on ground as
strong as the fit found it. What the drive adds is the expected log Bayes factor of the true effect
over another one, with sizes shared by the runs at hand and the new one, less that of the runs at
hand alone (``expected``). Of several pairs in doubt the one that gains least counts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import torch

from terrain_estimator.discovery.evidence.expected import Stage, stage
from terrain_estimator.discovery.evidence.isolability import (
    Signature,
    between,
    run_signatures,
    signatures,
    stages_of,
)
from terrain_estimator.discovery.evidence.study import Candidate, Study, velocities_of
from terrain_estimator.discovery.hypotheses.doubted_rows import rows_of
from terrain_estimator.discovery.hypotheses.equations import Query, RunEquations
from terrain_estimator.discovery.hypotheses.library import TYPICAL, Hypothesis
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.hypotheses.unknowns import Unknowns
from terrain_estimator.discovery.next_drive.manoeuvres import MANOEUVRES, SECONDS, Manoeuvre, drive
from terrain_estimator.discovery.next_drive.missing_signals import (
    MissingSignal,
    lacking,
    without_signals,
)
from terrain_estimator.discovery.runs import RecordedRun, RunError, cut
from terramechanics.effects import make_effect
from terramechanics.simulation.plant import Plant

SEED = 1
MOST = 4
"""Effects in doubt that are looked at."""


BESIDES = {
    "slope_bias": (
        "stand still on level ground in two headings: only a tilted sensor reads two pitches"
    ),
    "drive_drag": "lift the wheels and turn them at two rates: drag stays without soil",
    "coulomb_drag": (
        "lift the wheels and turn them in both directions: dry friction stays without soil"
    ),
    "payload": "weigh the rover",
    "multipass": "drive off the own track (crab or turn), then on it: what the rut does disappears",
    "odometry_scale": "roll a measured distance on a hard floor: a wrong radius stays there",
    "sinkage_bias": "stand on a hard floor, where sinkage has to read zero",
    "exit_angle": "measure the depth of the rut behind a wheel against the wheel's sinkage",
}
"""Advice by effect beyond the simulated drives: standing still, lifted wheels, a rule."""


@dataclass(frozen=True, slots=True)
class NextDrive:
    """A drive and its expected gain."""

    name: str
    words: str
    seconds: float
    nats: float  # gained for the pair in doubt that gains least
    pair: tuple[str, str]  # that pair: the first one true


def next_drives(
    study: Study,
    doubtful: Sequence[Hypothesis],
    around: Candidate,
    manoeuvres: Sequence[Manoeuvre] = MANOEUVRES,
) -> list[NextDrive]:
    """Return these manoeuvres, the best first; none with fewer than two effects in doubt.

    Ground and noise are those of ``around``.
    """
    doubtful = doubtful[:MOST]
    if len(doubtful) < 2:
        return []
    stages, known = stages_of(around), signatures(study, doubtful, around)
    pairs = list(permutations(range(len(doubtful)), 2))
    now = {pair: between(stages, known[pair[0]], known[pair[1]]) for pair in pairs}
    theta = torch.stack([run.theta for run in around.fit.point.runs]).mean(0)
    excess = torch.stack([each.excess for each in around.fit.equations]).mean(0)
    gains: dict[Manoeuvre, dict[tuple[int, int], float]] = {each: {} for each in manoeuvres}
    for true, runs in enumerate(_driven(study, doubtful, theta, manoeuvres)):
        for manoeuvre, run in zip(manoeuvres, runs, strict=True):
            more = _seen(study, run, doubtful, theta, excess)
            if more is None:
                continue
            joined = [signature.joined(new) for signature, new in zip(known, more[1], strict=True)]
            for pair in (pair for pair in pairs if pair[0] == true):
                gains[manoeuvre][pair] = (
                    between([*stages, more[0]], joined[pair[0]], joined[pair[1]]) - now[pair]
                )
    found = []
    for manoeuvre, each in gains.items():
        if len(each) == len(pairs):
            worst = min(each, key=lambda pair: each[pair])
            labels = (doubtful[worst[0]].label, doubtful[worst[1]].label)
            found.append(
                NextDrive(manoeuvre.name, manoeuvre.words, SECONDS, max(each[worst], 0.0), labels)
            )
    return sorted(found, key=lambda each: -each.nats)


def _driven(
    study: Study,
    doubtful: Sequence[Hypothesis],
    theta: torch.Tensor,
    manoeuvres: Sequence[Manoeuvre],
) -> list[list[RecordedRun]]:
    """Return the runs of all manoeuvres with each effect acting, by one simulation."""
    nominal = _ground(study)
    strength = theta * nominal.contact.column_unit[:2]
    count = len(manoeuvres)
    effects = []
    for k, hypothesis in enumerate(doubtful):
        acting = torch.zeros(len(doubtful) * count, dtype=torch.float64)
        acting[k * count : (k + 1) * count] = 1.0
        effects += [
            make_effect(effect.name, TYPICAL[effect.name] * acting, effect.axle)
            for effect in hypothesis.effects
        ]
    runs = drive(nominal, strength, tuple(manoeuvres) * len(doubtful), Plant(effects), SEED)
    return [runs[k * count : (k + 1) * count] for k in range(len(doubtful))]


def _ground(study: Study) -> Nominal:
    """Return the nominal model on the soil of a next drive: that of the first run."""
    return study.nominal.of(study.runs[0])


def _seen(
    study: Study,
    run: RecordedRun,
    doubtful: Sequence[Hypothesis],
    theta: torch.Tensor,
    excess: torch.Tensor,
) -> tuple[Stage, list[Signature]] | None:
    """Return the rows of a new run and the effects' signatures; None for a rover that stands.

    It has no signal that all runs at hand lack.
    """
    nominal = _ground(study)
    try:
        seen = without_signals(run, lacking(study.runs), nominal.rover.axles)
        blocks = cut(seen, nominal.contact)
    except RunError:
        return None
    constants = torch.zeros(nominal.uncertain.shape[0], dtype=torch.float64)
    unknowns = Unknowns(
        theta, constants, torch.zeros(1, dtype=torch.float64), velocities_of(blocks), nominal.prior
    )
    columns = torch.zeros(blocks.packed.shape[0], len(study.mask) + 1, 0, dtype=torch.float64)
    told, none = tuple(study.none.start()), torch.zeros(0, dtype=torch.float64)
    query = Query(unknowns, told, none, columns, study.none.shared().step, None)
    equations = RunEquations(blocks, rows_of(nominal, blocks, study.none), study.mask).at(query)
    there = stage(equations, unknowns, excess, len(told), len(study.runs))
    return there, run_signatures(nominal, blocks, study.mask, doubtful, unknowns, equations.around)


def advise(
    names: Sequence[str], drives: Sequence[NextDrive], signals: Sequence[MissingSignal]
) -> str:
    """Return advice on separating these effects; empty for fewer than two.

    ``drives`` and ``signals`` are the best first.
    """
    if len(set(names)) <= 1:
        return ""
    advice = [
        f"For {each} alone: {BESIDES[each]}" for each in sorted(set(names)) if each in BESIDES
    ]
    advice = [_measure(each) for each in signals if each.separates] + advice
    if drives:
        best, (true, other) = drives[0], drives[0].pair
        drive_first = (
            f"Drive {best.seconds:.0f} s {best.words}: {best.nats:.0f} nat more are expected, if it"
            f" is {true}, against {other}"
        )
        advice.insert(0, drive_first)
    return ". ".join(advice)


def _measure(signal: MissingSignal) -> str:
    true, other = signal.pair
    return (
        f"Measure the {signal.name}, too: with it {signal.nats:.0f} nat are expected of runs like"
        f" these, if it is {true}, against {other}, instead of {signal.without:.0f}"
    )
