# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Options of find_missing_effect --wheel-table."""

import argparse
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from rover_parameters.numerals import parse_number
from rover_parameters.records import ConfigError, nearest, shortened
from terrain_estimator.console.arguments import add_search_options, command_parser, effects
from terrain_estimator.discovery.single_wheel.cells import ROWS, Row
from terrain_estimator.discovery.single_wheel.free_law import MEASURED
from terrain_estimator.discovery.single_wheel.table import (
    CARRIAGE,
    SIDEWAYS_DEG,
    SLIP_DEFINITIONS,
    SLIP_RADII,
    SLIP_SPEEDS,
)
from terrain_estimator.model.rows import PA_PER_UNIT
from terrain_estimator.offline.run_soils import SOIL
from terrain_estimator.offline.wheel_finding_content import Measured, ShearBox

OPTIONAL_ROWS = {
    "lateral_force": (
        ("lateral_sd", "lateral_offset_sd"),
        "give a table with a column lateral_force_N at slip angles",
    ),
    "torque": (
        ("torque_sd", "torque_offset_sd"),
        "give a table with a column torque_Nm, or with current_A and --torque-constant",
    ),
}
"""Rows that not every table has: the options that concern each alone, and what gives the row."""


class Usual(float):
    """A default: an equal number that a user gives is none."""


def wheel_parser(description: str | None) -> argparse.ArgumentParser:
    """Return the parser of find_missing_effect --wheel-table."""
    parser = command_parser("find_missing_effect", description)
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
    parser.add_argument(
        "--soil",
        default=SOIL,
        help="name of a soil or path of a soil file (default: %(default)s)",
    )
    add_search_options(parser, "all others that one wheel shows", "bootstrap")
    parser.add_argument(
        "--prior-odds",
        default="",
        metavar="NAME=ODDS,...",
        help=(
            "how many times likelier than usual an effect is by what is known of the tables, as in"
            " grousers=10 where the wheel differs; the report states it (default: none)"
        ),
    )
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
        "--slip-radius",
        choices=SLIP_RADII,
        default="rim",
        help=(
            "r in the slip of --wheel-table: of the rim, or of the lugs' tips by the wheel file's"
            " lug_height; in --reference it is the rim's (default: %(default)s)"
        ),
    )
    parser.add_argument(
        "--slip-speed",
        choices=SLIP_SPEEDS,
        default=CARRIAGE,
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
        default="0.2",
        metavar="SHARE[,NAME=SHARE...]",
        help=(
            "relative deviation of each soil constant, with others for n, k (of k_c / b + k_phi),"
            " shear_modulus, c1 or c2 by name, as in 0.2,c1=0.5 (default: %(default)s)"
        ),
    )
    parser.add_argument(
        "--shear-box",
        default="",
        metavar="c=KPA+-SD,tan_phi=VALUE+-SD",
        help=(
            "c [kPa] and tan phi of a shear box, as in c=0.25+-0.1,tan_phi=0.62+-0.03: printed"
            " beside the estimate, and not used for it"
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
        default=Usual(0.35),
        help="repeatability of the lateral force [N] (default: %(default)s)",
    )
    parser.add_argument(
        "--torque-sd",
        type=float,
        default=Usual(0.02),
        help="repeatability of the torque [N m] (default: %(default)s)",
    )
    parser.add_argument(
        "--reading-sd",
        default="",
        metavar="NAME=SD,...",
        help=(
            "error of reading, beside repeatability, of slip [1], sinkage [m], drawbar_pull [N],"
            " lateral_force [N] or torque [N m], as of a figure that was traced (default: none)"
        ),
    )
    parser.add_argument(
        "--torque-constant",
        type=float,
        metavar="NM_PER_A",
        help=(
            "torque at the wheel for each ampere of the motor [N m/A], its gears included: a column"
            " current_A is then read as a torque (default: currents are not used)"
        ),
    )
    parser.add_argument(
        "--torque-constant-sd",
        type=float,
        default=Usual(0.1),
        help="relative deviation of --torque-constant, which is then free (default: %(default)s)",
    )
    for name, unit in (("pull", "N"), ("lateral", "N"), ("torque", "N m")):
        parser.add_argument(
            f"--{name}-offset-sd",
            type=float,
            default=0.0,
            help=(
                f"deviation of the zero of the {name}'s sensor [{unit}], which is then free; 0: it"
                " is known (default: %(default)s)"
            ),
        )


def check_options(options: argparse.Namespace) -> None:
    """Raise ConfigError for an invalid deviation or angle."""
    for name in ("pull_offset_sd", "lateral_offset_sd", "torque_offset_sd"):
        if not 0.0 <= getattr(options, name) < math.inf:
            raise ConfigError(
                f"{_given(options, name)}: give a finite number, 0 or above; 0 takes the zero as"
                " known"
            )
    if options.torque_constant is not None and not 0.0 < options.torque_constant < math.inf:
        raise ConfigError(
            f"--torque-constant {options.torque_constant:g}: it is above zero and finite; turn the"
            " sign of the current where it drives the wheel"
        )
    if not 0.0 <= options.torque_constant_sd < 1.0:
        raise ConfigError(
            f"--torque-constant-sd {options.torque_constant_sd:g}: it is relative: give 0 to less"
            " than 1, such as 0.1 for 10 %"
        )
    if options.torque_constant is None and _is_given(options, "torque_constant_sd"):
        raise ConfigError(
            f"{_given(options, 'torque_constant_sd')}: without --torque-constant no torque is read"
            " from a current, so this changes nothing: give both, or leave it out"
        )
    for name in ("sinkage_sd", "pull_sd", "lateral_sd", "torque_sd"):
        if not 0.0 < getattr(options, name) < math.inf:
            raise ConfigError(f"{_given(options, name)}: give a finite number above 0")
    if not 0.0 <= options.largest_slip_angle <= SIDEWAYS_DEG:
        raise ConfigError(
            f"--largest-slip-angle {options.largest_slip_angle:g}: give 0 to {SIDEWAYS_DEG:g} deg;"
            " beyond that a wheel does not roll"
        )


def check_effective(
    options: argparse.Namespace,
    rows: Sequence[Row],
    reading: Mapping[str, float],
    odds: Mapping[str, float],
    names: Sequence[str],
) -> None:
    """Raise ConfigError where an option concerns what none of the rows or effects has.

    ``reading`` are the stated errors of reading, ``odds`` the prior odds, ``names`` the effects
    that are looked for.
    """
    for row, (concerned, advice) in OPTIONAL_ROWS.items():
        if not all(math.isnan(getattr(each, row)) for each in rows):
            continue
        given = [_given(options, name) for name in concerned if _is_given(options, name)]
        given += [f"--reading-sd {row}={reading[row]:g}"] if reading.get(row) else []
        if given:
            raise ConfigError(
                f"{given[0]}: no row that is used has a {row.replace('_', ' ')}, so it changes"
                f" nothing: leave the option out, or {advice}"
            )
    if options.slip_speed != CARRIAGE and not any(each.slip_angle for each in rows):
        raise ConfigError(
            f"--slip-speed {options.slip_speed}: no row that is used has a slip angle, so it"
            " changes nothing: leave the option out, or give tables with a column slip_angle_deg"
        )
    if options.shear_box and all(math.isnan(each.torque) for each in rows):
        raise ConfigError(
            "--shear-box: no row that is used has a torque, so no c and tan phi are estimated that"
            f" it could stand beside: leave the option out, or {OPTIONAL_ROWS['torque'][1]}"
        )
    for name in odds:
        if name not in names:
            raise ConfigError(
                f"--prior-odds {name}={odds[name]:g}: {name} is not looked for, so its odds change"
                " nothing: leave them out, or add it to --library"
            )


def _is_given(options: argparse.Namespace, name: str) -> bool:
    """Return whether a deviation is stated that is not the default, nor 0 of one that 0 omits."""
    value = getattr(options, name)
    return not isinstance(value, Usual) and not (name.endswith("offset_sd") and value == 0.0)


def _given(options: argparse.Namespace, name: str) -> str:
    """Return an option and its number as they are written on the command line."""
    return f"--{name.replace('_', '-')} {getattr(options, name):g}"


def constants_sd(text: str) -> tuple[float, ...]:
    """Return the relative deviation of each constant of MEASURED; raises ConfigError."""
    option = "--constants-sd"
    first, *others = text.split(",")
    found = dict.fromkeys(MEASURED, _number(option, first))
    found |= _named(option, others, MEASURED)
    for name, share in found.items():
        if share >= 1.0:
            raise ConfigError(
                f"{option} {share:g}: it is relative to each constant: give less than 1, such as"
                " 0.2 for 20 %"
            )
        if not share > 0.0:
            raise ConfigError(f"{option} {share:g}: the deviation of {name} must be above zero")
    return tuple(found.values())


def reading_sd(text: str) -> dict[str, float]:
    """Return the stated errors of reading, of slip and ROWS; raises ConfigError."""
    found = _named("--reading-sd", text.split(",") if text else [], ("slip", *ROWS))
    for name, sd in found.items():
        if sd < 0.0:
            raise ConfigError(f"--reading-sd {name}={sd:g}: a standard deviation is not negative")
    return found


def prior_odds(text: str, known: Sequence[str]) -> dict[str, float]:
    """Return the prior odds of names over what is usual; raises ConfigError."""
    found = _named("--prior-odds", text.split(",") if text else [], known)
    for name, odds in found.items():
        if not odds > 0.0:
            raise ConfigError(
                f"--prior-odds {name}={odds:g}: odds are above zero; use --library to leave an"
                " effect out"
            )
    return found


def shear_box(text: str) -> ShearBox | None:
    """Return what a shear box gave; None where nothing is said. Raises ConfigError."""
    if not text:
        return None
    option = "--shear-box"
    said = [each.replace("=", "+-").split("+-") for each in text.split(",")]
    texts = {each[0].strip(): each[1:] for each in said}
    found = {
        name: [_number(option, each) for each in values]
        for name, values in texts.items()
        if len(values) == 2
    }
    if set(found) != {"c", "tan_phi"} or min(map(min, found.values())) < 0.0:
        raise ConfigError(
            f"{option} {shortened(text)}: give both values with their deviations, none negative, as"
            " in c=0.25+-0.1,tan_phi=0.62+-0.03 (c in kPa)"
        )
    cohesion, cohesion_sd = (PA_PER_UNIT * each for each in found["c"])
    return ShearBox(Measured(cohesion, cohesion_sd), Measured(*found["tan_phi"]))


def _named(option: str, entries: Sequence[str], known: Sequence[str]) -> dict[str, float]:
    """Return the numbers of entries NAME=NUMBER."""
    found = {}
    for each in entries:
        name, _, value = each.partition("=")
        if name.strip() not in known:
            raise ConfigError(
                f"{option} {shortened(each)}: unknown name: {nearest(name.strip(), known)}"
            )
        found[name.strip()] = _number(option, value)
    return found


def _number(option: str, text: str) -> float:
    try:
        value = parse_number(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ConfigError(f"{option}: {shortened(text)} is no finite number")
    return value
