# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect --wheel-table FILE.csv...: find the effect that a model of one wheel lacks.

Writes OUT/finding.json and OUT/report.html. Exit codes: 0 for any verdict, 2 for a bad argument or
table. c and tan phi are reported where the tables have a torque: without it they are not
identified.
"""

import argparse
import dataclasses
import itertools
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from rover_parameters.records import ConfigError, number
from rover_parameters.yaml_files import load
from terrain_estimator.console.arguments import (
    add_search_options,
    command_parser,
    effects,
    refuse_twice,
)
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.discovery.evidence.verdict import read_thresholds
from terrain_estimator.discovery.hypotheses.library import Hypothesis, together
from terrain_estimator.discovery.single_wheel.cells import (
    DATUM_SD,
    Rig,
    Row,
    cells_of,
    wheel_alone,
)
from terrain_estimator.discovery.single_wheel.investigation import (
    investigate_wheel,
    lacking_in_reference,
    of_one_wheel,
    shown_by_one_wheel,
)
from terrain_estimator.discovery.single_wheel.table import (
    SIDEWAYS_DEG,
    SLIP_DEFINITIONS,
    SLIP_SPEEDS,
    WheelTableError,
    read_table,
)
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.offline.finding_file import FINDING, write_finding
from terrain_estimator.offline.wheel_finding_content import wheel_content, wheel_sentence
from terrain_estimator.pages.wheel_finding import wheel_page
from terramechanics.effects import describe
from terramechanics.presets import load_rover, load_soil

LARGEST = 2.0
"""[m] Largest wheel of a testbed; a larger number is in another unit."""
FEWEST = 3
"""Fewest settings of which a statement is possible."""
SIDEWAYS = "lateral_bulldozing"


@dataclass(frozen=True, slots=True)
class TestbedWheel:
    """A wheel on a testbed."""

    name: str
    radius: float = number("radius of the rim", "m", 0.0, LARGEST, exclusive=True)
    width: float = number("width", "m", 0.0, LARGEST, exclusive=True)


def main(arguments: list[str] | None = None) -> int:
    """Investigate the tables that the command line names; return the exit code."""
    options = _parser().parse_args(arguments)
    torch.set_num_threads(1)
    try:
        _check(options)
        results = ResultFolder(options.out)
        results.check(*FINDING)
        wheel = load(TestbedWheel, options.wheel)
        rover = wheel_alone(load_rover("mars_rover"), wheel.radius, wheel.width)
        bed = Rig(
            rover,
            load_soil(options.soil).for_wheel(wheel.width),
            options.constants_sd,
            (options.sinkage_sd, options.pull_sd, options.lateral_sd, options.torque_sd),
            (DATUM_SD, options.pull_offset_sd, 0.0, options.torque_offset_sd),
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
        thresholds = read_thresholds()
        with torch.inference_mode(), ProgressReport("find_missing_effect: reference") as report:
            lacking = lacking_in_reference(
                bed, rows, reference, given, names, thresholds, report.at, options.seed
            )
        given = together(given, lacking)
        names = _others(names, lacking)
        with torch.inference_mode(), ProgressReport("find_missing_effect") as report:
            outcome = investigate_wheel(
                bed,
                rows,
                reference,
                given,
                names,
                thresholds,
                report.at,
                by_trial=by_trial,
                seed=options.seed,
            )
        asked_for = {
            "wheel": wheel.name,
            "soil": bed.soil.name,
            "reference": [path.name for path in options.reference],
            "reference_lacks": list(lacking.names),
        }
        content = wheel_content(
            outcome, bed, rows, reference, given, tables, by_trial=by_trial, seed=options.seed
        )
        content |= {"left_out": left_out, "asked": asked_for, "given": list(known)}
        with results.renewing(*FINDING) as new:
            write_finding(new, content, wheel_page)
    except (ConfigError, WheelTableError, OSError) as error:
        sys.stderr.write(f"find_missing_effect: {error}\n")
        return 2
    if lacking.names:
        sys.stdout.write(
            f"The tables of --reference alone lack {lacking.label}, which is taken to act in all"
            " tables.\n"
        )
    sys.stdout.write(
        "\n".join(
            [
                wheel_sentence(outcome, bed, cells_of(rows, reference)),
                *(str(options.out / name) for name in FINDING),
            ]
        )
        + "\n"
    )
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("find_missing_effect", __doc__)
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
        help="tables of the same soil in which the effect does not act",
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
    add_search_options(parser, "all others that one wheel shows", "bootstrap")
    parser.add_argument(
        "--hold-out-by",
        choices=("cell", "trial"),
        default="cell",
        help=(
            "unit that is held out in turn: one setting with all its replicates, or one trial of"
            " all settings (default: %(default)s)"
        ),
    )
    _add_slip(parser)
    _add_deviations(parser)
    return parser


def _add_slip(parser: argparse.ArgumentParser) -> None:
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
            "rows above this angle [deg] are left out; 0 keeps rows with the wheel straight ahead"
            " (default: %(default)s)"
        ),
    )


def _add_deviations(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--constants-sd",
        type=float,
        default=0.2,
        help="relative deviation of each soil constant (default: %(default)s)",
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
        "--torque-sd",
        type=float,
        default=0.02,
        help="repeatability of the torque [N m] (default: %(default)s)",
    )
    for name, unit in (("pull", "N"), ("torque", "N m")):
        parser.add_argument(
            f"--{name}-offset-sd",
            type=float,
            default=0.0,
            help=(
                f"deviation of the zero of the {name}'s sensor [{unit}], which is then free; 0: it"
                " is known (default: %(default)s)"
            ),
        )


def _check(options: argparse.Namespace) -> None:
    """Raise ConfigError for an invalid deviation or angle."""
    for name in ("pull_offset_sd", "torque_offset_sd"):
        if not 0.0 <= getattr(options, name) < math.inf:
            raise ConfigError(
                f"--{name.replace('_', '-')} {getattr(options, name):g}: a standard deviation is"
                " not negative"
            )
    for name in ("constants_sd", "sinkage_sd", "pull_sd", "lateral_sd", "torque_sd"):
        if not 0.0 < getattr(options, name) < math.inf:
            raise ConfigError(
                f"--{name.replace('_', '-')} {getattr(options, name):g}: a standard deviation must"
                " be above zero"
            )
    if options.constants_sd >= 1.0:
        raise ConfigError(
            f"--constants-sd {options.constants_sd:g}: it is relative to each constant: give less"
            " than 1, such as 0.2 for 20 %"
        )
    if not 0.0 <= options.largest_slip_angle <= SIDEWAYS_DEG:
        raise ConfigError(
            f"--largest-slip-angle {options.largest_slip_angle:g}: give 0 to {SIDEWAYS_DEG:g} deg;"
            " beyond that a wheel does not roll"
        )


def _check_rows(rows: Sequence[Row], reference: frozenset[str], *, by_trial: bool) -> None:
    if all(row.table in reference for row in rows):
        raise WheelTableError(
            "no row of --wheel-table can be used, and the tables of --reference alone cannot show a"
            " missing effect"
        )
    if by_trial and not reference and len({row.trial for row in rows}) < 2:
        raise WheelTableError(
            "--hold-out-by trial: there is one trial, so nothing would be left to fit; hold"
            " out by cell"
        )


def _names(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names; ConfigError for an effect that one wheel does not show."""
    for name in names:
        describe(name)
        if name not in shown_by_one_wheel():
            known = ", ".join(shown_by_one_wheel())
            raise ConfigError(f"effect {name} is not testable with one wheel; testable are {known}")
    return names


def _testable(asked: Sequence[str], known: Sequence[str], rows: Sequence[Row]) -> tuple[str, ...]:
    """Return the effects to look for.

    Raises ConfigError where one of them is also given, or needs a slip angle that no row has.
    """
    turned = any(row.slip_angle for row in rows)
    if SIDEWAYS in (*asked, *known) and not turned:
        raise ConfigError(
            f"effect {SIDEWAYS} is not testable: no row has a slip angle and a lateral force"
        )
    if both := [name for name in asked if name in known]:
        raise ConfigError(
            f"effect {both[0]} is in --library and in --given: an effect that acts in all tables"
            " cannot be looked for"
        )
    return tuple(asked) or tuple(
        name for name in shown_by_one_wheel() if name not in known and (turned or name != SIDEWAYS)
    )


def _others(names: Sequence[str], lacking: Hypothesis) -> tuple[str, ...]:
    """Return the effects that the reference does not lack; ConfigError where none is left."""
    others = tuple(name for name in names if name not in lacking.names)
    if not others:
        raise ConfigError(
            f"the tables of --reference alone lack {lacking.label}, so it is not what differs, and"
            " nothing else is looked for: name other effects in --library"
        )
    return others


def _refuse_equal(rows: Sequence[Row]) -> None:
    """Raise WheelTableError where two tables share more than half of the rows of one of them."""
    by_table: dict[str, set[str]] = {}
    for row in rows:
        by_table.setdefault(row.table, set()).add(repr(dataclasses.replace(row, table="")))
    for (first, some), (second, others) in itertools.combinations(by_table.items(), 2):
        shared, fewest = len(some & others), min(len(some), len(others))
        if 2 * shared > fewest:
            raise WheelTableError(
                f"{first} and {second} have {shared} of {fewest} rows in common: every measurement"
                " counts once; give one of them"
            )


def _read(
    bed: Rig, tables: Sequence[Path], options: argparse.Namespace
) -> tuple[list[Row], list[str]]:
    """Read the rows that the contact model describes; report the others."""
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
    _refuse_equal(usable)
    for reason in left_out:
        sys.stderr.write(f"find_missing_effect: {reason}\n")
    if len(cells_of(usable).slip) < FEWEST:
        raise WheelTableError(
            f"{len(cells_of(usable).slip)} settings can be used, at least {FEWEST} are needed"
        )
    return usable, left_out


if __name__ == "__main__":
    sys.exit(main())
