# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Cells of the accuracy tables: drives, rows and model; each is reproducible by itself."""

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from studies.accuracy import scores as accuracy
from studies.accuracy.scores import (
    FROM_PRIOR,
    PAPER_BAND,
    TIMES_S,
    CellScore,
    Judged,
    MeasuredDrives,
    draw_drives,
    judge,
    observation_times,
    row_mask,
)
from studies.batched import Trace, run
from studies.bound import Known, cramer_rao_at
from studies.reference import grid_posterior
from terrain_estimator.learning.restore import physics_alone, restore
from terrain_estimator.learning.tasks import ROVERS, SOILS
from terrain_estimator.model.metadata import model_names
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_with_effects import nominal_of
from terrain_estimator.model.rows import regression_rows
from terramechanics.presets import load_rover, load_soil

WRONG = 0.05
"""[1] Largest relative error of each soil constant where the constants are wrong."""
REFERENCE_EPISODES = 20
SIDE_BATCHES = 2
"""Batches in which other schedules, the paper's band and the models that ship are judged, too."""
EVERY_ROW = "v+L+M+B"
TARGET_ROWS = ("v+L+M", EVERY_ROW)
"""Row sets of the targets: with wheel torques, and with the moment balances, too."""
SHIPPED_ROWS = ("v+L", *TARGET_ROWS)
"""Row sets that a node can have."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One set of drives, simulated once."""

    rover: str
    soil: str
    schedule: str = "S1"
    spread: float = 0.0  # [1] of the soil constants
    truth: str = "prior"  # of c and tan phi: the models' prior, or "paper", its tests' range
    rows: tuple[str, ...] = (EVERY_ROW,)
    times_s: tuple[float, ...] = TIMES_S  # [s] at which it is judged; a drive lasts until the last


@dataclass(frozen=True, slots=True)
class AccuracyCell:
    """One line of the tables."""

    rover: str
    soil: str
    schedule: str
    spread: float
    truth: str
    rows: str
    model: str  # "physics" (constants exact where they are), "shipped" or "with net"
    score: CellScore


@dataclass(frozen=True, slots=True)
class ReferenceCheck:
    """Distance of the recursion from the grid posterior over some episodes, in its deviations."""

    rover: str
    soil: str
    episodes: int
    median_shift: tuple[float, float]
    largest_shift: tuple[float, float]
    spread_ratio: tuple[float, float]  # median of published over grid deviation
    largest_edge: float  # posterior mass on the edge of the grid


@dataclass(frozen=True, slots=True)
class NetShare:
    """Share of the learnt columns at the end of the drives: rms over rms of the nominal force."""

    rover: str
    soil: str
    spread: float
    velocity: float
    load: float
    torque: float


@dataclass(frozen=True, slots=True)
class CellBatch:
    """Results of some of the drives of a setting."""

    judged: dict[tuple[str, str], Judged]  # by rows and model
    reference: list[ReferenceCheck]
    net: list[NetShare]


def settings() -> list[Setting]:
    """Return every setting of the tables."""
    every = ("v", "v+L", *TARGET_ROWS)
    cells = [
        Setting(rover, soil, spread=spread, rows=every)
        for rover in ROVERS
        for soil in SOILS
        for spread in (0.0, WRONG)
    ]
    for rover in ROVERS:
        cells += [
            Setting(rover, "loose_sand", schedule, rows=("v", *TARGET_ROWS))
            for schedule in ("S2", "S3", "S4")
        ]
        cells.append(Setting(rover, "loose_sand", truth="paper", rows=("v", *TARGET_ROWS)))
    return cells


def is_main(setting: Setting) -> bool:
    """Return whether the targets apply: drives of 40 s over hills (S1), truth from the prior."""
    return (setting.schedule, setting.truth, setting.times_s) == ("S1", "prior", TIMES_S)


def seed_of(setting: Setting, seed: int, batch: int) -> int:
    """Return the seed of a batch of a setting, so that batches can run in any order and number."""
    return seed + zlib.crc32(repr((setting, batch)).encode()) % 1_000_000


def study(setting: Setting, episodes: int, seed: int, batch: int = 0) -> CellBatch:
    """Simulate a batch of drives of a setting and judge every row set and model on them.

    In the first SIDE_BATCHES of the main settings the models that ship are judged, too; the first
    batch of all is compared with the grid and measures the share of the net.
    """
    rover, soil = load_rover(setting.rover), load_soil(setting.soil)
    truth = PAPER_BAND if setting.truth == "paper" else FROM_PRIOR
    drives = draw_drives(
        rover,
        soil,
        setting.schedule,
        episodes,
        setting.spread,
        seed_of(setting, seed, batch),
        truth,
        duration_s=setting.times_s[-1],
    )
    physics = physics_alone(rover, soil, exact=not setting.spread)
    part = CellBatch({}, [], [])
    for rows, bound in zip(setting.rows, _bounds(physics, drives, setting), strict=True):
        trace = _run(physics, drives, rows, setting.times_s)
        part.judged[rows, "physics"] = judge(trace, drives, bound, physics.hypotheses.prior_sd)
        if not is_main(setting):
            continue
        if rows == EVERY_ROW and not setting.spread and batch == 0:
            part.reference.append(_check(physics, drives, trace, setting))
        if rows in SHIPPED_ROWS and batch < SIDE_BATCHES and rover.name in model_names():
            _judge_shipped(part, setting, drives, rows, bound, batch)
    return part


def _judge_shipped(
    part: CellBatch, setting: Setting, drives: MeasuredDrives, rows: str, bound: Tensor, batch: int
) -> None:
    """Judge the model that ships, and, with every row, the one with a net and its share."""
    loaded = load_model(setting.rover)
    model = restore(loaded)
    prior_sd = model.hypotheses.prior_sd
    part.judged[rows, "shipped"] = judge(_run(model, drives, rows), drives, bound, prior_sd)
    if rows != EVERY_ROW:
        return
    learnt = restore(load_model(f"{setting.rover}_with_net"))
    trace = _run(learnt, drives, rows)
    part.judged[rows, "with net"] = judge(trace, drives, bound, prior_sd)
    if batch == 0:
        known = [each.name for each in loaded.metadata.soils].index(setting.soil)
        part.net.append(_share(learnt, known, drives, trace, setting))


def cells(setting: Setting, parts: Sequence[CellBatch]) -> list[AccuracyCell]:
    """Return the cells of all parts of a setting together.

    They are judged after whole drives.
    """
    place = (setting.rover, setting.soil, setting.schedule, setting.spread, setting.truth)
    found: dict[tuple[str, str], list[Judged]] = {}
    for part in parts:
        for key, judged in part.judged.items():
            found.setdefault(key, []).append(judged)
    lines = []
    for key, judgements in found.items():
        score = accuracy.score(accuracy.pool(judgements))
        lines.append(AccuracyCell(*place, *key, score))
    return lines


def _bounds(model: PAlpaca, drives: MeasuredDrives, setting: Setting) -> Tensor:
    """Return the bounds with each row set of the setting [S, N, K, 2, 2]."""
    sets = torch.stack([row_mask(rows, model.axles) for rows in setting.rows])
    known = Known(sets, drives.ends, drives.constants, setting.spread / math.sqrt(3.0))
    return cramer_rao_at(model, drives.tasks, observation_times(setting.times_s), known)


def _run(
    model: PAlpaca, drives: MeasuredDrives, rows: str, times_s: Sequence[float] = TIMES_S
) -> Trace:
    return run(
        model,
        drives.tasks.measured,
        observation_times(times_s),
        drives.ends,
        row_mask(rows, model.axles),
    )


def _check(
    model: PAlpaca, drives: MeasuredDrives, trace: Trace, setting: Setting
) -> ReferenceCheck:
    """Compare with the grid posterior on the first episodes that do not get stuck at once."""
    chosen = torch.nonzero(drives.ends > model.block_size).squeeze(1)[:REFERENCE_EPISODES].tolist()
    mask = row_mask(EVERY_ROW, model.axles)
    shifts, spreads, edges = [], [], []
    for episode in chosen:
        mean, covariance = trace.mean[episode, -1], trace.covariance[episode, -1]
        reference = grid_posterior(
            model, drives.tasks.measured[episode], int(drives.ends[episode]), mask
        )
        sd = reference.covariance.diagonal().sqrt()
        shifts.append((mean - reference.mean).abs() / sd)
        spreads.append(covariance.diagonal().sqrt() / sd)
        edges.append(reference.edge)
    shift, spread = torch.stack(shifts), torch.stack(spreads)
    distances = (
        _pair(shift.median(0).values),
        _pair(shift.amax(0)),
        _pair(spread.median(0).values),
    )
    return ReferenceCheck(setting.rover, setting.soil, len(chosen), *distances, max(edges))


def _pair(values: Tensor) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _share(
    model: PAlpaca, soil: int, drives: MeasuredDrives, trace: Trace, setting: Setting
) -> NetShare:
    """Return the learnt part of each row over its nominal part, at the last posterior mean.

    Taken on the first observation of each block that was used.
    """
    packed = drives.tasks.measured[:, :: model.block_size]
    starts = torch.arange(0, drives.tasks.measured.shape[1], model.block_size)
    kept = starts < drives.ends.unsqueeze(1)
    flat = packed[kept]
    rows = regression_rows(flat, flat, nominal_of(model.physics).nominal_contact(soil))
    final = trace.final.unsqueeze(1).expand(-1, packed.shape[1], -1)[kept].unsqueeze(-1)
    theta = torch.cat([final[:, :2], torch.ones_like(final[:, :1])], 1)
    nominal = (rows.features[0] @ theta).squeeze(-1) * rows.used
    columns = torch.where(rows.used.unsqueeze(-1) > 0.0, model.learnt(flat), 0.0)
    learnt = (columns @ final[:, 2 : model.layout.first_constant]).squeeze(-1)
    share = learnt.square().mean(0).sqrt() / nominal.square().mean(0).sqrt()
    return NetShare(
        setting.rover,
        setting.soil,
        setting.spread,
        float(share[0]),
        float(share[1]),
        float(share[2 : 2 + model.axles].mean()),
    )
