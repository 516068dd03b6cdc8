# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect --wheel-table FILE.csv...: what the model of one wheel on a testbed lacks.

Writes OUT/finding.json and OUT/report.html. Exit codes: 0 for any verdict, 2 for a bad argument or
table. c and tan phi are never told: without drive torque they are not identified.
"""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from rover_parameters.records import ConfigError, load, number
from terrain_estimator.console.arguments import SEED, effects, make_folder, refuse_twice
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.discovery.evidence.verdict import Verdict, read_thresholds
from terrain_estimator.discovery.hypotheses.library import Hypothesis
from terrain_estimator.discovery.single_wheel import (
    Rig,
    Row,
    WheelFinding,
    investigate_wheel,
    of_one_wheel,
    shown_by_one_wheel,
)
from terrain_estimator.discovery.single_wheel.cells import ROWS, cells_of, wheel_alone
from terrain_estimator.discovery.single_wheel.investigation import FLOOR
from terrain_estimator.discovery.single_wheel.table import (
    SIDEWAYS_DEG,
    SLIP_DEFINITIONS,
    SLIP_SPEEDS,
    WheelTableError,
    read_table,
)
from terrain_estimator.pages.wheel_finding import wheel_page
from terramechanics.effects import describe
from terramechanics.terrain.soil import load_soil
from terramechanics.vehicle.rover import load_rover

LARGEST = 2.0
"""[m] No wheel of a testbed is larger: the number is in another unit."""
FEWEST = 3
"""Cells without which nothing can be said."""
NOT_IDENTIFIED = (
    "c and tan phi are not identified: these tables have no drive torque; they were left free and"
    " are not given"
)
SIDEWAYS = "lateral_bulldozing"
REPLICATES = "replicates of one setting are one measurement"


@dataclass(frozen=True, slots=True)
class TestbedWheel:
    """A wheel on a testbed."""

    name: str
    radius: float = number("radius of the rim", "m", 0.0, LARGEST, exclusive=True)
    width: float = number("width", "m", 0.0, LARGEST, exclusive=True)


def main(arguments: list[str] | None = None) -> int:
    """Investigate the tables that the command line names; returns the exit code."""
    options = _parser().parse_args(arguments)
    torch.set_num_threads(1)
    try:
        _check(options)
        wheel = load(TestbedWheel, options.wheel)
        rover = wheel_alone(load_rover("mars_rover"), wheel.radius, wheel.width)
        bed = Rig(
            rover,
            load_soil(options.soil),
            options.constants_sd,
            (options.sinkage_sd, options.pull_sd, options.lateral_sd),
        )
        asked, known = _names(options.library), _names(options.given)
        tables = [*options.wheel_table, *options.reference]
        refuse_twice(
            tables, "every measurement counts once, and the effect acts in its table or does not"
        )
        given = Hypothesis(tuple(each.effects[0] for each in of_one_wheel(known)))
        rows, left_out = _read(bed, tables, options)
        names = _testable(asked, known, rows)
        reference = frozenset(map(str, options.reference))
        by_trial = options.hold_out_by == "trial"
        _check_rows(rows, reference, by_trial=by_trial)
        make_folder("--out", options.out)
        with torch.inference_mode(), ProgressReport("find_missing_effect") as report:
            outcome = investigate_wheel(
                bed,
                rows,
                reference,
                given,
                names,
                read_thresholds(),
                report.at,
                by_trial=by_trial,
                seed=options.seed,
            )
        asked_for = {
            "wheel": wheel.name,
            "soil": bed.soil.name,
            "reference": [path.name for path in options.reference],
        }
        content = summary(outcome, bed, rows, reference, given, options) | {
            "left_out": left_out,
            "asked": asked_for,
        }
        text = json.dumps(content, indent=1, allow_nan=False) + "\n"
        (options.out / "finding.json").write_text(text, encoding="utf-8")
        (options.out / "report.html").write_text(wheel_page(content), encoding="utf-8")
    except (ConfigError, WheelTableError, OSError) as error:
        sys.stderr.write(f"find_missing_effect: {error}\n")
        return 2
    sys.stdout.write(
        f"{sentence(outcome, bed)}\n{options.out / 'finding.json'}\n{options.out / 'report.html'}\n"
    )
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="find_missing_effect",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--wheel-table",
        nargs="+",
        type=Path,
        required=True,
        metavar="FILE.csv",
        help="tables in which an effect may act",
    )
    parser.add_argument(
        "--reference",
        nargs="+",
        type=Path,
        default=[],
        metavar="FILE.csv",
        help="tables of the same soil in which it does not act",
    )
    parser.add_argument(
        "--given",
        type=effects,
        default=(),
        metavar="NAME,...",
        help="effects that are known to act in all tables",
    )
    parser.add_argument(
        "--wheel", type=Path, required=True, help="file of the wheel: name, radius and width [m]"
    )
    parser.add_argument(
        "--soil",
        default="loose_sand",
        help="name of a soil or path of a soil file (default: %(default)s)",
    )
    parser.add_argument(
        "--constants-sd",
        type=float,
        default=0.2,
        help="relative deviation of each soil constant (default: %(default)s)",
    )
    parser.add_argument(
        "--slip-definition",
        choices=SLIP_DEFINITIONS,
        default="rim",
        help="1 - V / (r w), or (r w - V) / max(r w, V) (default: %(default)s)",
    )
    parser.add_argument(
        "--slip-speed",
        choices=SLIP_SPEEDS,
        default="carriage",
        help=(
            "V in the slip of rows with a slip angle: the carriage's speed, or its part along the"
            " wheel's heading (default: %(default)s)"
        ),
    )
    parser.add_argument(
        "--largest-slip-angle",
        type=float,
        default=SIDEWAYS_DEG,
        help=(
            "rows above it [deg] are left out: 0 keeps those in which the wheel moves straight"
            " ahead (default: %(default)s)"
        ),
    )
    parser.add_argument(
        "--sinkage-sd",
        type=float,
        default=0.65e-3,
        help="repeatability of the sinkage [m] (default: %(default)s)",
    )
    parser.add_argument(
        "--pull-sd",
        type=float,
        default=0.35,
        help="repeatability of the drawbar pull [N] (default: %(default)s)",
    )
    parser.add_argument(
        "--lateral-sd",
        type=float,
        default=0.35,
        help="repeatability of the lateral force [N] (default: %(default)s)",
    )
    parser.add_argument(
        "--hold-out-by",
        choices=("cell", "trial"),
        default="cell",
        help=(
            "what is held out in turn: one setting with all its replicates, or one trial of all"
            " settings (default: %(default)s)"
        ),
    )
    parser.add_argument(
        "--library",
        type=effects,
        default=(),
        metavar="NAME,...",
        help="effects to consider (default: all others that one wheel shows)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/finding"),
        help="folder of the results (default: %(default)s)",
    )
    parser.add_argument(
        "--seed", type=SEED, default=0, help="of the bootstrap (default: %(default)s)"
    )
    return parser


def _check(options: argparse.Namespace) -> None:
    """Raises ConfigError for a deviation or an angle that is none."""
    for name in ("constants_sd", "sinkage_sd", "pull_sd", "lateral_sd"):
        if not 0.0 < getattr(options, name) < math.inf:
            raise ConfigError(
                f"--{name.replace('_', '-')} {getattr(options, name):g}: a standard deviation is"
                " above zero"
            )
    if options.constants_sd >= 1.0:
        raise ConfigError(
            f"--constants-sd {options.constants_sd:g}: it is relative to each constant, give less"
            " than 1: 0.2 for 20 %"
        )
    if not 0.0 <= options.largest_slip_angle <= SIDEWAYS_DEG:
        raise ConfigError(
            f"--largest-slip-angle {options.largest_slip_angle:g}: give 0 to {SIDEWAYS_DEG:g} deg;"
            " beyond, a wheel does not roll"
        )


def _check_rows(rows: Sequence[Row], reference: frozenset[str], *, by_trial: bool) -> None:
    if all(row.table in reference for row in rows):
        raise WheelTableError(
            "no row of --wheel-table can be used: the tables of --reference alone do not say what"
            " it lacks"
        )
    if by_trial and not reference and len({row.trial for row in rows}) < 2:
        raise WheelTableError(
            "--hold-out-by trial: there is one trial, so nothing would be left to fit; hold out by"
            " cell"
        )


def _names(names: tuple[str, ...]) -> tuple[str, ...]:
    """The same. Raises ConfigError where one wheel does not show one of them."""
    for name in names:
        describe(name)
        if name not in shown_by_one_wheel():
            known = ", ".join(shown_by_one_wheel())
            raise ConfigError(f"effect {name} is not testable with one wheel; testable are {known}")
    return names


def _testable(asked: Sequence[str], known: Sequence[str], rows: Sequence[Row]) -> tuple[str, ...]:
    """The effects to look for. Raises ConfigError where one is given too, or needs a slip angle and there is none."""
    turned = any(row.slip_angle for row in rows)
    if SIDEWAYS in (*asked, *known) and not turned:
        raise ConfigError(
            f"effect {SIDEWAYS} is not testable: no row has a slip angle and a lateral force"
        )
    if both := [name for name in asked if name in known]:
        raise ConfigError(
            f"effect {both[0]} stands in --library and in --given: what acts in all tables is not"
            " looked for"
        )
    return tuple(asked) or tuple(
        name for name in shown_by_one_wheel() if name not in known and (turned or name != SIDEWAYS)
    )


def _read(
    bed: Rig, tables: Sequence[Path], options: argparse.Namespace
) -> tuple[list[Row], list[str]]:
    """Rows that the contact model describes; the others are reported."""
    usable: list[Row] = []
    left_out: list[str] = []
    for path in tables:
        rows, without = read_table(
            path, options.slip_definition, options.slip_speed, options.largest_slip_angle
        )
        outside = [row for row in rows if not bed.usable(row.slip, row.sinkage)]
        left_out += without + [
            f"{path}: slip {row.slip:.3f}, trial {row.trial}: outside of the contact model"
            for row in outside
        ]
        usable += [row for row in rows if row not in outside]
    for reason in left_out:
        sys.stderr.write(f"find_missing_effect: {reason}\n")
    if len(cells_of(usable).slip) < FEWEST:
        raise WheelTableError(
            f"{len(cells_of(usable).slip)} settings can be used, at least {FEWEST} are needed"
        )
    return usable, left_out


def summary(
    outcome: WheelFinding,
    bed: Rig,
    rows: Sequence[Row],
    reference: frozenset[str],
    given: Hypothesis,
    options: argparse.Namespace,
) -> dict[str, Any]:
    """What goes to finding.json: the shape of drives' findings."""
    judgement, cells = outcome.judgement, cells_of(rows, reference)
    tried = int(cells.acts.sum())
    return {
        "verdict": str(judgement.verdict),
        "probabilities": judgement.probabilities,
        "effects": [
            entry for hypothesis in judgement.named for entry in _effects(outcome, hypothesis)
        ],
        "confusable_with": [each.label for each in judgement.named[1:]],
        "separate_by": outcome.separate_by,
        "where": [],
        "left": (
            [dict(zip(("row", "signal"), outcome.left, strict=True))]
            if judgement.verdict is Verdict.UNKNOWN
            else []
        ),
        "gap": _gap(outcome, bed, options.seed),
        "parameters": {"before": None, "after": None, "why": NOT_IDENTIFIED},
        "runs": [path.name for path in (*options.wheel_table, *options.reference)],
        "held_out": [
            (
                f"each of {tried} settings in turn"
                if options.hold_out_by == "cell"
                else "each trial in turn"
            )
        ],
        "rows": [name for name, seen in zip(ROWS, cells.seen.any(0).tolist(), strict=True) if seen],
        "settings": len(cells.slip),
        "measurements": len(rows),
        "given": list(given.names),
        "limits": [NOT_IDENTIFIED, REPLICATES],
    }


def _effects(outcome: WheelFinding, hypothesis: Hypothesis) -> list[dict[str, Any]]:
    found = next(each for each in outcome.found if each.hypothesis == hypothesis)
    probability = outcome.judgement.probabilities.get(" + ".join(hypothesis.names), 0.0)
    factor = found.log_evidence - outcome.nothing.log_evidence
    return [
        {
            "name": name,
            "coefficient": size,
            "sd": sd,
            "unit": describe(name).unit,
            "probability": probability,
            "log_bayes_factor": factor,
        }
        for name, size, sd in found.sizes(outcome.first)
    ]


def _gap(outcome: WheelFinding, bed: Rig, seed: int) -> dict[str, Any]:
    """On held-out settings: in deviations of repeatability, and row by row in units."""
    errors = outcome.held_out
    before, after = errors.rms(bed.repeatability)
    closed = None if after is None or before <= FLOOR else (before - after) / (before - FLOOR)
    interval = errors.improvement_95(bed.repeatability, seed)
    closed_95 = (
        None
        if interval is None or before <= FLOOR
        else [end / (before - FLOOR) for end in interval]
    )
    rows = {}
    for k, (name, unit) in enumerate(zip(ROWS, ("m", "N", "N"), strict=True)):
        seen = ~np.isnan(errors.before[:, k])
        if seen.any():
            said = (
                None if errors.after is None else float((errors.after[seen, k] ** 2).mean() ** 0.5)
            )
            said_before = float((errors.before[seen, k] ** 2).mean() ** 0.5)
            rows[name] = {
                "before": said_before,
                "after": said,
                "noise_floor": bed.repeatability[k],
                "unit": unit,
            }
    gap = {
        "before": before,
        "after": after,
        "noise_floor": FLOOR,
        "closed": closed,
        "closed_95": closed_95,
    }
    return gap | {"rows": rows, "proven": outcome.proven, "settings": errors.settings}


def sentence(outcome: WheelFinding, bed: Rig) -> str:
    """The verdict in words."""
    judgement = outcome.judgement
    labels = ", ".join(each.label for each in judgement.named)
    words = {
        Verdict.NONE: "nothing is missing that these tables show",
        Verdict.NAMED: f"named: {labels}",
        Verdict.CONFUSABLE: f"confusable: {labels}. To separate: {outcome.separate_by}",
        Verdict.UNKNOWN: (
            f"unknown (closest: {labels}; what is left depends most on {outcome.left[1]} in the"
            f" {outcome.left[0]} row)"
        ),
    }[judgement.verdict]
    before, after = outcome.held_out.rms(bed.repeatability)
    proven = {None: "too few settings to prove it", True: "proven", False: "not proven"}[
        outcome.proven
    ]
    told = (
        ""
        if after is None
        else (
            f"; held-out error from {before:.2f} to {after:.2f} deviations of repeatability,"
            f" {proven}"
        )
    )
    return f"{words}{told}. {NOT_IDENTIFIED[0].upper()}{NOT_IDENTIFIED[1:]}."


if __name__ == "__main__":
    sys.exit(main())
