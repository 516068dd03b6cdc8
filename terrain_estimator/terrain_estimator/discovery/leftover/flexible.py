# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A discrepancy without a name: weights on smooth functions of the signals, in every row.

It measures how much of the residual depends on anything at all, in which row and on which
signal.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from terrain_estimator.discovery.runs import Blocks, Signals
from terrain_estimator.model.block import row_weights
from terrain_estimator.model.packing import view_of


@dataclass(frozen=True, slots=True)
class Column:
    """The row and the function of a signal that one weight is for."""

    row: str
    signal: str


@dataclass(frozen=True, slots=True)
class Flexible:
    """Columns of the discrepancy for every run, each of unit mean square over all runs."""

    names: tuple[Column, ...]  # F
    columns: tuple[Tensor, ...]  # [B, Q, F] of each run


def no_columns(runs: Sequence[Blocks]) -> Flexible:
    """Return no discrepancy."""
    rows = len(runs[0].rows) + 1
    return Flexible(
        (), tuple(torch.zeros(run.packed.shape[0], rows, 0, dtype=torch.float64) for run in runs)
    )


def flexible(runs: Sequence[Blocks]) -> Flexible:
    """Return smooth functions of every signal in every row, scaled over all runs together."""
    axles = runs[0].wheel_rate.shape[-1]
    tables = [_functions(run.signals, axles) for run in runs]
    names: list[Column] = []
    values: list[list[Tensor]] = [[] for _ in runs]
    for row, name in enumerate(runs[0].rows):
        for signal, wanted in tables[0].items():
            own = signal.startswith("wheel_")
            if own and not (name.startswith("torque") and signal.endswith(f"_{row - 2}")):
                continue
            if name.startswith("torque") and not own and signal.startswith("each_"):
                continue
            del wanted
            function = torch.cat([table[signal] for table in tables])
            centre, spread = function.mean(), function.std().clamp(min=1e-12)
            if signal == "constant":
                centre, spread = torch.zeros(()), torch.ones(())
            names.append(Column(name, signal.removeprefix("wheel_").removeprefix("each_")))
            for column, run, table in zip(values, runs, tables, strict=True):
                column.append(in_row((table[signal] - centre) / spread, row, run))
    return Flexible(tuple(names), tuple(torch.stack(columns, -1) for columns in values))


def _functions(signals: Signals, axles: int) -> dict[str, Tensor]:
    """Return functions [B] of the signals by name.

    ``wheel_..._k`` is for the torque row of axle k, ``each_`` for the body's rows.
    """
    time, distance, pitch = signals.time[:, 0], signals.distance[:, 0], signals.pitch[:, 0]
    functions = {
        "constant": torch.ones_like(time),
        "time": time,
        "time^2": time**2,
        "pitch": pitch,
        "pitch^2": pitch**2,
    }
    functions |= {
        f"distance around {2 * k} m": torch.relu(1.0 - (distance - 2.0 * k).abs() / 2.0)
        for k in range(4)
    }
    turning = signals.pitch_rate[:, 0]
    functions |= {
        "distance": distance,
        "pitch rate": turning,
        "time x pitch": time * pitch,
        "time x pitch rate": time * turning,
    }
    for yaw_rate in signals.yaw_rate.unbind(1):
        functions |= {"yaw rate": yaw_rate, "yaw rate^2": yaw_rate**2}
    for axle in range(axles):
        slip, sinkage, speed = (
            signals.slip[:, axle],
            signals.sinkage[:, axle],
            signals.speed[:, axle],
        )
        each = {
            "slip": slip,
            "sinkage": sinkage,
            "speed": speed,
            "slip rate": signals.slip_rate[:, axle],
        }
        deeper = signals.sinkage_rate[:, axle]
        own = each | {"slip^2": slip**2, "sinkage^2": sinkage**2, "sinkage rate": deeper}
        for angle in signals.slip_angle[:, axle : axle + 1].unbind(1):
            each |= {"slip angle": angle}
            own |= {"slip angle": angle, "slip angle^2": angle**2}
        own |= {f"time x {name}": time * each[name] for name in ("slip", "sinkage", "slip rate")}
        functions |= {f"each_{name}_{axle}": value for name, value in each.items()}
        functions |= {f"wheel_{name}_{axle}": value for name, value in own.items()}
    slip, sinkage = signals.slip.mean(1), signals.sinkage.mean(1)
    functions |= {
        "each_time x speed": time * signals.speed.mean(1),
        "each_time x slip": time * slip,
    }
    functions |= {
        "each_slip^2": slip**2,
        "each_sinkage^2": sinkage**2,
        "each_time x slip rate": time * signals.slip_rate.mean(1),
    }
    return functions


def in_row(values: Tensor, row: int, run: Blocks) -> Tensor:
    """Return a function [B] in one row of every observation as a column [B, Q] of the blocks."""
    blocks, count, _ = run.packed.shape
    axles, rows = run.wheel_rate.shape[-1], len(run.rows)
    used = torch.ones(blocks, count, rows, dtype=torch.float64)
    weight = row_weights(used, view_of(run.packed, axles).step)
    column = torch.zeros(blocks, rows + 1, dtype=torch.float64)
    places = (0, 1) if row == 0 else (row + 1,)
    for place in places:
        column[:, place] = values * weight[..., place].sum(1)
    return column
