# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of ``accuracy`` as a page in Markdown."""

from dataclasses import dataclass

from studies.accuracy.cells import EVERY_ROW, NetShare, ReferenceCheck
from studies.accuracy.lines import Claim, TableLine
from studies.accuracy.scores import TIMES_S, ParameterScore, Share
from studies.accuracy.targets import over_hills, verdicts
from studies.tables import LICENCE, table
from terrain_estimator.model.prior import DEFAULT_PRIOR


@dataclass(frozen=True, slots=True)
class AccuracyRun:
    """All that one run of ``accuracy`` found."""

    date: str
    episodes: int
    seed: int
    cells: list[TableLine]
    reference: list[ReferenceCheck]
    net: list[NetShare]


_INTRODUCTION = """# Accuracy

Written by `make accuracy` on {date}, seed {seed}; {done} of the {episodes} drives of 40 s that are meant for a cell over hills; the number
of each cell is in the tables. The figures do not depend on the number of processes.

Truth is drawn from the model's prior, independent Gaussians of c ({c}) kPa and tan phi ({tan}) above zero; "paper" is the paper's
test band, c 0.7 to 1.3 kPa and phi 20 to 45 deg, uniform. "5 %": each of the six soil constants is wrong by up to 5 %, independently, as
in the prior of the models that do not take them for exact. Rows: v velocity,
L load, M wheel torques, B moment balances. A node always has v and L; without `use_torque` and `use_moments` it has v+L. An episode
ends at its first stuck second and keeps its last estimate; the share of such episodes is in the tables. "Bound" is the median error
of an estimator that reaches the Cramer-Rao bound of the same drives, with the noise of slip, sinkage and angles propagated, the prior
added and wrong constants as unknowns. "Ratio" is the median of error / bound, 1 for an efficient estimator. Coverages stand with
their 99 % confidence limits. NIS is the misfit of a block over its degrees of freedom (1 is right), NLL the mean negative log
density of the true (c in kPa, tan phi) at 40 s.

What these figures are not:

- **"Physics" is not a model that ships.** It is told the soil, has no net, and takes the soil constants for exact in the drives where
  they are; no command exports it. It shows what the method can do. **"Shipped"** are the model files of the package: they have to find
  the soil among three, have a net, and carry the constants as parameters always. They were judged on {side} drives a cell.
- **No drive here goes through the node's estimator.** Blocks, rows and bank are the same, computed in batches, but screening, gates and
  doubt are bypassed and the accelerometer is not used. [stream_study.md](stream_study.md) is of that estimator.
- **The bound is not the tightest.** It counts the rover's mass (1 %) and centre of mass (2 cm) as unknown, with the deviations of the
  model's prior, as the estimator does. Those of the simulated rover are always the file's, never drawn from that prior. Knowing both
  exactly would lower the bound by 0.1 to 4 % of itself (60 drives on loose sand of each rover, v+L+M and v+L+M+B).
"""
_REASONS = """
Where these are missed, and why:

- **Median errors** with exact constants: the bound of these rows is above the target or just below it, and the errors stand at the bound.
- **Velocity.** The filter that is judged here expects a velocity from the slip and sinkage of the same sample, and gates with it; what
  `MotionPrediction` publishes is made a sample before ([stream_study.md](stream_study.md)). The filter's deviation agrees with its
  innovations and its intervals hold what they say, but it is wider than the velocity sensor's noise: the force that moves the rover in
  between follows from slip and sinkage, which are measured to 5 %. Where this noise is larger, a deviation within 20 % of the sensor's
  would cover too little.
- **Velocity alone** with wrong constants. The intervals do not stay wide: they cover less than they say, and the status calls parameters
  identified that cannot be. A node always has the load row, too. The derivative of a row by a soil constant is proportional to c and
  tan phi, and every block takes it where the estimate is then; as noise moves the estimate, the blocks together seem to tell apart
  what none of them can (Huang, Mourikis and Roumeliotis, 2010, on the consistency of Kalman filters). On regolith (100 drives, c / tan phi)
  the 95 % intervals hold 84 / 82 %, with one hypothesis instead of nine, none born, 49 / 51 %, and without noise they are a little
  wide. A trial that also keeps the information about the products of c and tan phi with each constant, so that all blocks have the
  newest derivatives, held 92 / 91 % with one hypothesis, but lost the posterior's definiteness in 4 of the drives. It is not in the models.
- **68 % of tan phi on compact sand**, Mars-like rover: with exact constants 15 % of the drives are stuck before the first estimate, nearly
  all of them on ground of little friction, and keep the prior, whose interval holds 6 % of these truths: that a rover is stuck is no
  observation. Of the drives that are not, the interval holds 66 to 68 %.
- **Least deviation.** The bound is that of the true parameters, the posterior is taken at the estimated ones and of this drive's noise,
  so single drives lie below it.
"""
_LONG = """The same ground all the way. What shifts every row a little to one side is nothing beside the interval after 40 s; the interval
shrinks with the root of time, the shift stays.

"""


def page(run: AccuracyRun) -> str:
    """The whole page."""
    hills, shipped = over_hills(run.cells, "physics"), over_hills(run.cells, "shipped")
    long = [line for line in run.cells if line.duration_s > TIMES_S[-1]]
    others = [
        line
        for line in run.cells
        if (line.schedule, line.truth) != ("S1", "prior") and line.model == "physics"
    ]
    said = {
        "date": run.date,
        "episodes": run.episodes,
        "seed": run.seed,
        "done": _drives(hills),
        "side": _drives(shipped),
    }
    said["c"] = f"{DEFAULT_PRIOR.cohesion_pa / 1e3:g} +- {DEFAULT_PRIOR.cohesion_sd_pa / 1e3:g}"
    said["tan"] = f"{DEFAULT_PRIOR.tan_phi:g} +- {DEFAULT_PRIOR.tan_phi_sd:g}"
    head = ("what", "target", "found", "met")
    parts = [
        LICENCE + _INTRODUCTION.format(**said),
        f"## Targets, physics alone, {_drives(hills)} drives a cell\n\n"
        + table(head, verdicts(run.cells, "physics"))
        + _REASONS,
        f"## Targets, the models that ship, {_drives(shipped)} drives a cell\n\n"
        + table(head, verdicts(run.cells, "shipped")),
        "## After 40 s over hills (S1), physics alone\n\n" + _final(hills),
        "## After 40 s over hills (S1), the models that ship\n\n" + _final(shipped),
        "## Error over time over hills (S1), physics alone\n\n" + _over_time(hills),
        "## Long drives over hills (S1), physics alone\n\n" + _LONG + _long(long),
        "## Other schedules and the paper's test band, physics alone\n\n"
        + _final(others)
        + "\n"
        + _over_time(others),
        "## The velocity filter, and what the status says\n\n" + _velocity([*hills, *shipped]),
        "## Distance from a grid reference\n\n" + _reference(run.reference),
        "## Share and ablation of the net\n\n" + _net(run),
    ]
    return "\n".join(parts)


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


def _coverage(share: Share) -> str:
    return f"{_percent(share.share)} ({_percent(share.low)} to {_percent(share.high)})"


def _final(cells: list[TableLine]) -> str:
    head = (
        *_PLACE, "c median / p90 %", "c bound %", "c ratio", "tan phi median / p90 %", "tan phi bound %", "tan phi ratio",
        "c in 95 %", "tan phi in 95 %", "c in 68 %", "tan phi in 68 %", "both in 95 % ellipse", "NIS", "NLL", "stuck %",
    )  # fmt: skip
    lines = []
    for cell in cells:
        score, line = cell.score, [*_place(cell)]
        for parameter in (score.cohesion, score.tan_phi):
            errors = f"{_percent(parameter.median_error[-1])} / {_percent(parameter.p90_error[-1])}"
            line += [errors, _percent(parameter.bound[-1]), f"{parameter.ratio_to_bound[-1]:.2f}"]
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
    return (
        "Median / 90th percentile of the relative error in %, in brackets the bound.\n\n"
        + table(head, lines)
    )


def _errors(parameter: ParameterScore) -> list[str]:
    series = zip(parameter.median_error, parameter.p90_error, parameter.bound, strict=True)
    return [
        f"{_percent(median)} / {_percent(high)} ({_percent(bound)})"
        for median, high, bound in series
    ]


def _long(cells: list[TableLine]) -> str:
    head = (
        *_PLACE,
        "after s",
        "c median % (bound)",
        "tan phi median % (bound)",
        "c in 95 %",
        "tan phi in 95 %",
        "both in 95 % ellipse",
    )
    lines = []
    for cell in cells:
        both = (cell.score.cohesion, cell.score.tan_phi)
        errors = [
            f"{_percent(found.median_error[-1])} ({_percent(found.bound[-1])})" for found in both
        ]
        shares = [*(found.coverage_95 for found in both), cell.score.joint_coverage_95]
        lines.append([*_place(cell), f"{cell.after_s:g}", *errors, *map(_coverage, shares)])
    return table(head, lines)


def _velocity(cells: list[TableLine]) -> str:
    explanation = (
        "Spread is the median predicted deviation over that of the velocity sensor: more than 1, as"
        " the force that moves the rover is\nknown through noisy slip and sinkage. Calibration is"
        " the rms predicted deviation over the rms innovation. Identified is the\nshare of drives"
        " whose status calls the parameter identified (at most a tenth of the prior's variance"
        " left), in brackets of those\nwhere the bound would not be. Covered is the share of the"
        " drives called identified whose 95 % interval holds the truth.\nNarrowest is the 1 %"
        " quantile of the published deviation over the bound, in brackets the least of any"
        " drive.\n\n"
    )
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
    return explanation + table(
        (*_PLACE, "model", "in 95 %", "spread", "calibration", "NLL", *said), lines
    )


def _claimed(parameter: ParameterScore, claim: Claim) -> tuple[str, str, str]:
    covered = _coverage(claim.covered) if claim.covered else ""
    return (
        f"{_percent(parameter.identified)} ({_percent(claim.unfounded)})",
        covered,
        f"{parameter.narrowest:.2f} ({claim.least:.2f})",
    )


def _reference(checks: list[ReferenceCheck]) -> str:
    explanation = (
        "The posterior on a grid over (c, tan phi), with velocity and bias marginalised exactly at"
        f" each point, from the same block rows;\nrows {EVERY_ROW}, exact constants. Distances in"
        " standard deviations of the grid posterior, c / tan phi.\n\n"
    )
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
    return explanation + table(head, lines)


def _net(run: AccuracyRun) -> str:
    explanation = (
        "The models that ship, with their learnt columns and without them, on the same drives; both"
        " have the soil constants as\nparameters. Physics is the model of the tables above, which"
        " takes exact constants for exact. The share is the rms of the learnt\npart of a row over"
        " that of its nominal part, at the last posterior mean.\n\n"
    )
    shares = {(share.rover, share.soil, share.spread): share for share in run.net}
    lines = []
    for cell in run.cells:
        share = shares.get((cell.rover, cell.soil, cell.spread))
        if share is None or (cell.schedule, cell.truth, cell.duration_s, cell.rows) != (
            "S1",
            "prior",
            TIMES_S[-1],
            EVERY_ROW,
        ):
            continue
        said = (
            f"{_percent(share.velocity)} / {_percent(share.load)} / {_percent(share.torque)}"
            if cell.model == "shipped"
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
    return explanation + table(head, lines)


def _ablation(cell: TableLine) -> list[str]:
    score = cell.score
    errors = [_percent(score.cohesion.median_error[-1]), _percent(score.tan_phi.median_error[-1])]
    return [
        *errors,
        *(_coverage(p.coverage_95) for p in (score.cohesion, score.tan_phi)),
        f"{score.nll:.2f}",
        f"{score.velocity_nll:.3f}",
    ]
