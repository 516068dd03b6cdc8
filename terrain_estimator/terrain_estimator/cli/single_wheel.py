# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect --wheel-table FILE.csv...: find the effect that a model of one wheel lacks.

Writes OUT/finding.json and OUT/report.html. Exit codes: 0 for any verdict, 2 for a bad argument or
table. Two fits of the contact law are reported: with all constants free, and with the constants as
measured, with c and tan phi where the tables have a torque. Without it they are not identified.
"""

import argparse
import dataclasses
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

import torch

from rover_parameters.records import ConfigError
from rover_parameters.yaml_files import load
from terrain_estimator.cli.wheel_options import (
    check_effective,
    check_options,
    constants_sd,
    prior_odds,
    reading_sd,
    shear_box,
    wheel_parser,
)
from terrain_estimator.console.arguments import refuse_twice
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.discovery.hypotheses.library import Hypothesis, together
from terrain_estimator.discovery.single_wheel.cells import (
    DATUM_SD,
    ROWS,
    Rig,
    Row,
    TestbedWheel,
    cells_of,
    wheel_alone,
)
from terrain_estimator.discovery.single_wheel.investigation import (
    investigate_wheel,
    lacking_in_reference,
    of_one_wheel,
    shown_by_one_wheel,
)
from terrain_estimator.discovery.single_wheel.law_fits import law_fits
from terrain_estimator.discovery.single_wheel.table import (
    WheelTableError,
    read_table,
)
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.offline.finding_file import FINDING, write_finding
from terrain_estimator.offline.wheel_finding_content import wheel_content, wheel_sentence
from terrain_estimator.pages.wheel_finding import wheel_page
from terrain_estimator.pages.wheel_fits import fit_sentences
from terramechanics.effects import describe
from terramechanics.presets import load_rover, load_soil
from terramechanics.terrain.soil import WONG_REECE, Soil

FEWEST = 3
"""Fewest settings of which a statement is possible."""
SIDEWAYS = "lateral_bulldozing"


def main(arguments: list[str] | None = None) -> int:
    """Investigate the tables that the command line names; return the exit code."""
    options = wheel_parser(__doc__).parse_args(arguments)
    torch.set_num_threads(1)
    try:
        check_options(options)
        box, reading = shear_box(options.shear_box), reading_sd(options.reading_sd)
        odds = prior_odds(options.prior_odds, shown_by_one_wheel())
        results = ResultFolder(options.out)
        results.check(*FINDING)
        wheel = load(TestbedWheel, options.wheel)
        rover = wheel_alone(load_rover("mars_rover"), wheel.radius, wheel.width)
        bed = Rig(
            rover,
            _soil(options.soil, wheel.width),
            constants_sd(options.constants_sd),
            (options.sinkage_sd, options.pull_sd, options.lateral_sd, options.torque_sd),
            (
                DATUM_SD,
                options.pull_offset_sd,
                options.lateral_offset_sd,
                options.torque_offset_sd,
            ),
            tuple(reading.get(name, 0.0) for name in ROWS),
            reading.get("slip", 0.0),
            (0.0, 0.0, 0.0, options.torque_constant_sd if options.torque_constant else 0.0),
        )
        asked, known = _names(options.library), _names(options.given)
        tables = [*options.wheel_table, *options.reference]
        refuse_twice(
            tables, "every measurement counts once, and the effect acts in its table or does not"
        )
        given = Hypothesis(tuple(each.effects[0] for each in of_one_wheel(known)))
        rows, left_out = _read(bed, tables, options, _slip_radius(wheel, options))
        names = _testable(asked, known, rows)
        reference = frozenset(map(str, options.reference))
        by_trial = options.hold_out_by == "trial"
        _check_rows(rows, reference, by_trial=by_trial)
        check_effective(options, rows, reading, odds, names)
        with torch.inference_mode(), ProgressReport("find_missing_effect: reference") as report:
            lacking = lacking_in_reference(
                bed, rows, reference, given, names, report.at, options.seed
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
                report.at,
                odds=odds,
                by_trial=by_trial,
                seed=options.seed,
            )
        with torch.inference_mode(), ProgressReport("find_missing_effect: soil") as report:
            cells = cells_of(rows, reference)
            fits = law_fits(bed, cells, given, outcome.added, report.at, options.seed)
        asked_for = {
            "wheel": wheel.name,
            "soil": bed.soil.name,
            "reference": [path.name for path in options.reference],
            "reference_lacks": list(lacking.names),
            "prior_odds": odds,
        }
        content = wheel_content(
            outcome,
            fits,
            bed,
            rows,
            reference,
            given,
            tables,
            box,
            by_trial=by_trial,
            seed=options.seed,
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
                wheel_sentence(outcome, bed),
                *fit_sentences(content["fits"]),
                *(str(options.out / name) for name in FINDING),
            ]
        )
        + "\n"
    )
    return 0


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


def _soil(name: str, width: float) -> Soil:
    """Return the soil for a wheel of a ``width`` [m]; raises ConfigError."""
    soil = load_soil(name).for_wheel(width)
    if soil.law != WONG_REECE:
        raise ConfigError(
            f"--soil {name}: law {soil.law}: tables of single wheels are fitted by {WONG_REECE}"
            " alone"
        )
    return soil


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


def _slip_radius(wheel: TestbedWheel, options: argparse.Namespace) -> float:
    """Return the radius in the slip of --wheel-table over that of the rim; raises ConfigError."""
    if options.slip_radius == "rim":
        return 1.0
    if wheel.lug_height == 0.0:
        raise ConfigError(
            f"--slip-radius lug: {options.wheel} has no lug_height: give the height of the lugs [m]"
        )
    return 1.0 + wheel.lug_height / wheel.radius


def _read(
    bed: Rig, tables: Sequence[Path], options: argparse.Namespace, radius_ratio: float
) -> tuple[list[Row], list[str]]:
    """Read the rows that the contact model describes; report the others.

    ``radius_ratio`` is the radius in the slip of --wheel-table over that of the rim.
    """
    usable: list[Row] = []
    left_out: list[str] = []
    for path in tables:
        rows, without = read_table(
            path,
            options.slip_definition,
            options.slip_speed,
            options.largest_slip_angle,
            radius_ratio if path in options.wheel_table else 1.0,
            options.torque_constant,
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
