# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The pages of ``make accuracy``: one of headline figures and targets, one of all tables."""

import re
from dataclasses import dataclass

from studies.accuracy.cells import EVERY_ROW, NetShare, ReferenceCheck
from studies.accuracy.lines import Claim, TableLine
from studies.accuracy.scores import TIMES_S, ParameterScore
from studies.accuracy.targets import over_hills, verdicts
from studies.limited import Limited
from studies.tables import licence, table
from terrain_estimator.model.prior import DEFAULT_PRIOR


@dataclass(frozen=True, slots=True)
class AccuracyRun:
    """All results of one run of ``accuracy``."""

    measured: str  # date, commit and code, as :func:`docs.provenance.measured` writes them
    episodes: int
    seed: int
    cells: list[TableLine]
    reference: list[ReferenceCheck]
    net: list[NetShare]


INTRODUCTION = """# Accuracy

{measured}

How large are the errors of c and tan phi after 40 s, and how often does the 95 % interval cover
the truth? The drives are simulated, over hills (S1), seed {seed}: {done} of the {episodes} drives
planned for each cell of the method, {side} for each cell of the models that ship.

## The models that ship, after 40 s with every row

Errors are relative; the bound is the median error that an efficient estimator would have on the
same drives. Every other row set, drive and soil is in [accuracy_tables.md](accuracy_tables.md).

"""
METHOD = """
## How the drives are judged

- **Truth.** c and tan phi are drawn from the model's prior: independent Gaussians of
  c ({c} kPa) and tan phi ({tan}), both above zero. "Paper" is the paper's test
  band: uniform in c 0.7 to 1.3 kPa and phi 20 to 45 deg.
- **Constants.** "5 %": each of the six soil constants is wrong by up to 5 %, independently, as in
  the prior of the models that estimate them.
- **Rows.** v velocity, L load, M wheel torques, B moment balances. A node always has v and L.
  Without `use_torque` and `use_moments` it has v+L.
- **Stuck.** An episode ends at its first stuck second and keeps its last estimate.
- **Bound.** The median error of an estimator that reaches the Cramér-Rao bound of the same drives:
  with the propagated noise of slip, sinkage and angles, the prior, and wrong constants as unknowns.
- **Ratio.** The median of error / bound, 1 for an efficient estimator.
- **Limits.** Coverages have 99 % confidence limits.
- **NIS.** The misfit of a block over its degrees of freedom; 1 is right.
- **NLL.** The mean negative log density of the true (c in kPa, tan phi) at 40 s.

The figures do not depend on the number of processes.

## What these figures do not show

- **"Physics" is not a model that ships.** It is given the soil, and takes the soil constants as
  exact in the drives where they are. No command exports it. It shows what the method can reach.
  **"Shipped"** are the model files of the package. They have no net either, have to find the soil
  among three, and always carry the constants as parameters.
- **No drive here goes through the node's estimator.** Blocks, rows and bank are the same, computed
  in batches. Screening, gates and the inflation after a suspected change are bypassed, and the
  accelerometer is not used. [stream_study.md](stream_study.md) judges that estimator.
- **The bound is not the tightest.** Like the estimator, it treats the rover's mass (1 %) and centre
  of mass (2 cm) as unknown, with the deviations of the model's prior. The simulated rover always
  has the file's values. Knowing both exactly would lower the bound by 0.1 to 4 % of its
  value (60 drives on loose sand of each rover, v+L+M and v+L+M+B).

"""
REASONS = """
Why targets are missed:

- **Median errors** with exact constants: the bound of these rows is above the target or just below
  it, and the errors are at the bound.
- **Velocity.** The filter judged here predicts a velocity from the slip and sinkage of the same
  sample, and gates with it. `MotionPrediction` is computed one sample earlier
  ([stream_study.md](stream_study.md)). The filter's deviation agrees with its innovations, and its
  intervals have their nominal coverage. But the deviation is larger than the velocity sensor's
  noise, because the force that moves the rover between samples follows from slip and sinkage, which
  are measured to 5 %. Where this noise is larger, a deviation within 20 % of the sensor's would
  cover too little.
- **Velocity alone** with wrong constants. The intervals become too narrow, and the status is
  identified for parameters that these rows cannot identify. A node has the load row, too, or its
  status is never identified.
  The derivative of a row with respect to a soil constant is proportional to c and tan phi. Every
  block takes it at its own estimate. As noise moves the estimate, the blocks together seem to
  separate what none of them can (Huang, Mourikis and Roumeliotis, 2010, on the consistency of
  Kalman filters). In trials with an older model on regolith (100 drives, c / tan phi) the 95 %
  intervals covered the truth in 84 / 82 %. With one hypothesis instead of nine, and no new ones,
  they covered it in 49 / 51 %; without noise they were slightly too wide. In one trial the
  estimator also kept the information about the products of c and tan phi with each constant, so
  that all blocks have the newest derivatives. With one hypothesis the intervals then covered the
  truth in 92 / 91 %, but in 4 of the drives the posterior was no longer positive definite. The
  models do not use it.
- **Error over the bound** of the models that ship: the worst cells have exact constants. The bound
  takes these as known, the models as 5 % uncertain. With constants 5 % wrong and every row the
  ratio is 0.88 to 1.09.
- **Least deviation.** The bound is taken at the true parameters. The posterior is taken at the
  estimated ones, with the noise of one drive, so single drives lie below the bound.
"""
TABLES = """# Accuracy: all tables

{measured}

Terms and models are defined in [accuracy.md](accuracy.md#how-the-drives-are-judged). "Physics" is
the method on a known soil, without a net; "shipped" are the model files of the package.

"""
OVER_TIME = """Median / 90th percentile of the relative error in %, the bound in brackets.

"""
VELOCITY = """\
- **Spread**: the median predicted deviation over that of the velocity sensor. It is above 1,
  because the force that moves the rover follows from noisy slip and sinkage.
- **Calibration**: the rms predicted deviation over the rms innovation.
- **Identified**: the share of drives whose status is identified (at most a tenth of the prior's
  variance is left); in brackets the share of those that the bound would not identify.
- **Covered**: of the drives with status identified, the share whose 95 % interval covers the truth.
- **Narrowest**: the 1 % quantile of the published deviation over the bound; in brackets the least
  of any drive.

"""
REFERENCE = f"""\
The reference is the posterior on a grid over (c, tan phi), from the same block rows. Velocity and
bias are marginalised exactly at each point. Rows {EVERY_ROW}, exact constants. Distances are in
standard deviations of the grid posterior, c / tan phi.

"""
NET = """\
Models with and without learnt columns, on the same drives; "shipped" is the one that ships. All
have the soil constants as parameters. Physics is the model of the tables above, which takes exact
constants as exact. The share is the rms of the learnt part of a row over that of its nominal part,
at the last posterior mean.

"""


def page(run: AccuracyRun) -> str:
    """Return the page with the errors of the models that ship, and all targets."""
    hills, shipped = over_hills(run.cells, "physics"), over_hills(run.cells, "shipped")
    said = {
        "measured": run.measured,
        "episodes": run.episodes,
        "seed": run.seed,
        "done": _drives(hills),
        "side": _drives(shipped),
    }
    prior = {
        "c": f"{DEFAULT_PRIOR.cohesion_pa / 1e3:g} ± {DEFAULT_PRIOR.cohesion_sd_pa / 1e3:g}",
        "tan": f"{DEFAULT_PRIOR.tan_phi:g} ± {DEFAULT_PRIOR.tan_phi_sd:g}",
    }
    head = ("what", "target", "found", "met")
    parts = [
        licence("accuracy")
        + INTRODUCTION.format(**said)
        + _headline([line for line in shipped if line.rows == EVERY_ROW]),
        f"## Targets, the models that ship, {_drives(shipped)} drives a cell\n\n"
        + table(head, verdicts(run.cells, "shipped")),
        f"## Targets, physics alone, {_drives(hills)} drives a cell\n\n"
        + table(head, verdicts(run.cells, "physics"))
        + REASONS
        + METHOD.format(**prior)
        + "## All tables\n\n"
        + "".join(
            f"- [{title}](accuracy_tables.md#{anchor(title)})\n" for title, _ in _tables(run)
        ),
    ]
    return "\n".join(parts)


def tables_page(run: AccuracyRun) -> str:
    """Return the page of every cell."""
    sections = [f"## {title}\n\n{text}" for title, text in _tables(run)]
    return licence("accuracy") + TABLES.format(measured=run.measured) + "\n".join(sections)


def anchor(title: str) -> str:
    """Return the fragment by which a link reaches a heading."""
    return re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")


def _tables(run: AccuracyRun) -> list[tuple[str, str]]:
    """Return the long tables, each with its title."""
    hills, shipped = over_hills(run.cells, "physics"), over_hills(run.cells, "shipped")
    others = [
        line
        for line in run.cells
        if (line.schedule, line.truth) != ("S1", "prior") and line.model == "physics"
    ]
    return [
        ("After 40 s over hills (S1), the models that ship", _final(shipped)),
        ("After 40 s over hills (S1), physics alone", _final(hills)),
        ("Error over time over hills (S1), physics alone", _over_time(hills)),
        (
            "Other schedules and the paper's test band, physics alone",
            _final(others) + "\n" + _over_time(others),
        ),
        ("The velocity filter and the status", VELOCITY + _velocity([*hills, *shipped])),
        ("Distance from a grid reference", REFERENCE + _reference(run.reference)),
        ("Share and ablation of the net", NET + _net(run)),
    ]


def _headline(cells: list[TableLine]) -> str:
    head = (
        "rover", "soil", "constants", "drives", "c median / p90 %", "c bound %",
        "tan phi median / p90 %", "tan phi bound %", "c in 95 %", "tan phi in 95 %",
    )  # fmt: skip
    lines = []
    for cell in cells:
        rover, soil, _, constants, _, drives = _place(cell)
        both = (cell.score.cohesion, cell.score.tan_phi)
        errors = [text for found in both for text in _final_errors(found)[:2]]
        shares = [_coverage(found.coverage_95) for found in both]
        lines.append([rover, soil, constants, drives, *errors, *shares])
    return table(head, lines)


def _final_errors(parameter: ParameterScore) -> tuple[str, str, str]:
    """Return median and 90th percentile of the error, the bound, and their ratio."""
    errors = f"{_percent(parameter.median_error[-1])} / {_percent(parameter.p90_error[-1])}"
    return errors, _percent(parameter.bound[-1]), f"{parameter.ratio_to_bound[-1]:.2f}"


def _drives(lines: list[TableLine]) -> int:
    return min((line.score.episodes for line in lines), default=0)


def _place(cell: TableLine) -> tuple[str, ...]:
    schedule = "paper band" if cell.truth == "paper" else cell.schedule
    constants, drives = "5 %" if cell.spread else "exact", str(cell.score.episodes)
    return (
        cell.rover.removesuffix("_rover"),
        cell.soil.removesuffix("_sand"),
        schedule,
        constants,
        cell.rows,
        drives,
    )


_PLACE = ("rover", "soil", "drive", "constants", "rows", "drives")


def _percent(value: float) -> str:
    return f"{100.0 * value:.1f}"


def _coverage(share: Limited) -> str:
    return f"{_percent(share.value)} ({_percent(share.low)} to {_percent(share.high)})"


def _final(cells: list[TableLine]) -> str:
    head = (
        *_PLACE, "c median / p90 %", "c bound %", "c ratio",
        "tan phi median / p90 %", "tan phi bound %", "tan phi ratio",
        "c in 95 %", "tan phi in 95 %", "c in 68 %", "tan phi in 68 %", "both in 95 % ellipse",
        "NIS", "NLL", "stuck %",
    )  # fmt: skip
    lines = []
    for cell in cells:
        score, line = cell.score, [*_place(cell)]
        line += [*_final_errors(score.cohesion), *_final_errors(score.tan_phi)]
        shares = (
            score.cohesion.coverage_95,
            score.tan_phi.coverage_95,
            score.cohesion.coverage_68,
            score.tan_phi.coverage_68,
        )
        line += [_coverage(share) for share in (*shares, score.joint_coverage_95)]
        lines.append([*line, f"{score.nis:.2f}", f"{score.nll:.2f}", _percent(score.stuck)])
    return table(head, lines)


def _over_time(cells: list[TableLine]) -> str:
    head = (*_PLACE, *(f"{name} {time:g} s" for name in ("c", "tan phi") for time in TIMES_S))
    lines = [
        [*_place(cell), *_errors(cell.score.cohesion), *_errors(cell.score.tan_phi)]
        for cell in cells
    ]
    return OVER_TIME + table(head, lines)


def _errors(parameter: ParameterScore) -> list[str]:
    series = zip(parameter.median_error, parameter.p90_error, parameter.bound, strict=True)
    return [
        f"{_percent(median)} / {_percent(high)} ({_percent(bound)})"
        for median, high, bound in series
    ]


def _velocity(cells: list[TableLine]) -> str:
    said = (
        f"{name} {what}"
        for name in ("c", "tan phi")
        for what in ("identified %", "covered", "narrowest")
    )
    lines = []
    for cell in cells:
        score = cell.score
        line = [
            *_place(cell),
            cell.model,
            _percent(score.velocity_coverage_95),
            f"{score.velocity_spread:.2f}",
        ]
        line += [f"{score.velocity_calibration:.2f}", f"{score.velocity_nll:.2f}"]
        lines.append(
            [
                *line,
                *_claimed(score.cohesion, cell.cohesion),
                *_claimed(score.tan_phi, cell.tan_phi),
            ]
        )
    return table((*_PLACE, "model", "in 95 %", "spread", "calibration", "NLL", *said), lines)


def _claimed(parameter: ParameterScore, claim: Claim) -> tuple[str, str, str]:
    covered = _coverage(claim.covered) if claim.covered else ""
    return (
        f"{_percent(parameter.identified)} ({_percent(claim.unfounded)})",
        covered,
        f"{parameter.narrowest:.2f} ({claim.least:.2f})",
    )


def _reference(checks: list[ReferenceCheck]) -> str:
    head = (
        "rover",
        "soil",
        "episodes",
        "median shift",
        "largest shift",
        "published / grid deviation",
    )
    lines = []
    for check in checks:
        pairs = (check.median_shift, check.largest_shift, check.spread_ratio)
        lines.append(
            [
                check.rover,
                check.soil,
                str(check.episodes),
                *(f"{a:.3f} / {b:.3f}" for a, b in pairs),
            ]
        )
    return table(head, lines)


def _net(run: AccuracyRun) -> str:
    shares = {(share.rover, share.soil, share.spread): share for share in run.net}
    lines = []
    for cell in run.cells:
        share = shares.get((cell.rover, cell.soil, cell.spread))
        if share is None or (cell.schedule, cell.truth, cell.rows) != (
            "S1",
            "prior",
            EVERY_ROW,
        ):
            continue
        said = (
            f"{_percent(share.velocity)} / {_percent(share.load)} / {_percent(share.torque)}"
            if cell.model == "with net"
            else ""
        )
        lines.append([*_place(cell), cell.model, *_ablation(cell), said])
    head = (
        *_PLACE,
        "model",
        "c %",
        "tan phi %",
        "c in 95 %",
        "tan phi in 95 %",
        "NLL",
        "velocity NLL",
        "share v / L / M %",
    )
    return table(head, lines)


def _ablation(cell: TableLine) -> list[str]:
    score = cell.score
    errors = [_percent(score.cohesion.median_error[-1]), _percent(score.tan_phi.median_error[-1])]
    return [
        *errors,
        *(_coverage(p.coverage_95) for p in (score.cohesion, score.tan_phi)),
        f"{score.nll:.2f}",
        f"{score.velocity_nll:.3f}",
    ]
