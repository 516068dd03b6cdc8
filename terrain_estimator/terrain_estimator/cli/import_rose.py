# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""import_rose TRIAL --rover ROVER --out BAG: convert a trial of RoSE Lab's dataset to a bag.

TRIAL is Processed_Data.csv or the raw MCAP recording of "Rover Mobility in a Lunar Analogue
Dataset" (CC BY 4.0). Exit codes: 0 done; 2 wrong arguments or data. See
docs/bring_your_own_data.md.
"""

import argparse
import dataclasses
import hashlib
import json
import math
import sys
from collections.abc import Mapping
from io import BufferedReader
from pathlib import Path
from typing import cast

from rover_parameters.records import ConfigError
from rover_parameters.regular_file import open_regular
from terrain_estimator.bags import ENDINGS, BagError, whole_bag
from terrain_estimator.console.arguments import command_parser, real
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.printing import print_lines
from terrain_estimator.files.atomic import OutputError
from terrain_estimator.files.results import new_folder
from terrain_estimator.importing.messages import SampleWriter
from terrain_estimator.importing.rose.doubts import doubts, faults
from terrain_estimator.importing.rose.recording import read_recording
from terrain_estimator.importing.rose.report import mapping_of, report
from terrain_estimator.importing.rose.samples import Found, find
from terrain_estimator.importing.rose.schema import (
    AXES,
    SOURCE,
    STAMPS,
    WHEELS,
    RoseOptions,
    names,
    wheel_order,
)
from terrain_estimator.importing.rose.table import read_table
from terrain_estimator.importing.rose.trial import Trial
from terrain_estimator.importing.samples import CsvError
from terrain_estimator.importing.units import UNITS
from terramechanics.presets import load_rover
from terramechanics.vehicle.rover import Rover

WRONG = 2


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Convert the trial that the command line names; return the exit code."""
    given = _parser().parse_args(arguments)
    try:
        options, rover = _options(given), load_rover(given.rover)
        wheel_order(rover)
        trial = _read(given.trial, options)
        found = convert(trial, given.trial, rover, options, given.out)
    except (ConfigError, CsvError, BagError, OutputError) as error:
        print(f"import_rose: {error}", file=sys.stderr)
        return WRONG
    except OSError as error:
        print(
            f"import_rose: {given.out}: the bag cannot be written: {error.strerror}",
            file=sys.stderr,
        )
        return WRONG
    notes = [*trial.notes, *report(found, options), *doubts(found, rover, options)]
    print_lines(
        [
            f"{given.out}: {len(found.samples)} samples of {given.trial}",
            *(f"note: {each}" for each in notes),
        ]
    )
    return 0


def convert(trial: Trial, path: Path, rover: Rover, options: RoseOptions, out: Path) -> Found:
    """Write a trial's bag; return what was found.

    Raises:
        CsvError: the trial contradicts itself; no bag is left behind.
        OutputError: the bag exists already or the disk is full; no bag is left behind.
    """
    found = find(trial, rover, options)
    for fault in faults(found, rover, options):
        raise CsvError(f"{trial.source}: {fault}")
    with new_folder(out) as place, whole_bag(place) as writer:
        stated = json.dumps(dataclasses.asdict(options), default=float)
        record = {"source": SOURCE, "file": path.name, "options": stated}
        writer.add_metadata("import_rose", record | _digest(path))
        SampleWriter(writer, mapping_of(rover, options)).write_all(found.samples)
    return found


def _digest(path: Path) -> dict[str, str]:
    if path.is_dir():
        return {}
    with open_regular(path) as file:
        digest = hashlib.file_digest(cast("BufferedReader", file), "sha256")
    return {"sha256": digest.hexdigest()}


def _read(path: Path, options: RoseOptions) -> Trial:
    """Read a trial of either format. Raises ConfigError for an option of the other one."""
    if path.is_dir() or path.name.endswith(ENDINGS):
        _refuse_given({"--column": options.columns}, f"{path} is a recording, not a CSV file")
        return read_recording(path, options)
    of_messages = {
        "--rate-fields": options.rate_fields,
        "--current-fields": options.current_fields,
        "--stamps log": options.stamps == "log",
    }
    _refuse_given(of_messages, f"{path} is a CSV file, not a recording")
    return read_table(path, options)


def _refuse_given(options: Mapping[str, object], why: str) -> None:
    for name, given in options.items():
        if given:
            raise ConfigError(f"{name}: {why}, so it changes nothing: leave it out")


def _options(given: argparse.Namespace) -> RoseOptions:
    """Return what the command line states. Raises ConfigError."""
    axes, signs = names(given.body_axes), names(given.wheel_signs)
    if len(axes) != 2 or not set(axes) <= set(AXES):
        raise ConfigError(
            f"--body-axes {given.body_axes}: give the axes of the pose that point forward and up,"
            f" with a comma, of {', '.join(AXES)}"
        )
    if len(signs) != WHEELS or not set(signs) <= {"1", "-1", "+1"}:
        raise ConfigError(f"--wheel-signs {given.wheel_signs}: give four of 1 and -1, with commas")
    columns = {}
    for rule in given.column:
        name, separator, theirs = rule.partition("=")
        if not (separator and theirs):
            raise ConfigError(f"--column {rule}: give NAME=NAME_IN_THE_FILE")
        columns[name] = theirs
    own = {
        field.name: getattr(given, field.name)
        for field in dataclasses.fields(RoseOptions)
        if hasattr(given, field.name)
    }
    return RoseOptions(
        **own
        | {
            "columns": columns,
            "body_axes": axes,
            "wheel_signs": tuple(map(float, signs)),
            "pitch_sd": math.radians(given.pitch_sd),
            "contact_angle_sd": math.radians(given.contact_angle_sd),
            "rate_fields": names(given.rate_fields),
            "current_fields": names(given.current_fields),
        }
    )


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("import_rose", __doc__)
    parser.add_argument("trial", type=Path, metavar="TRIAL", help="CSV file, MCAP file or bag")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="BAG", help="folder of the bag, must not exist"
    )
    parser.add_argument(
        "--rover",
        default="four_wheel_rover",
        help="name or file of the rover: its wheel radius and the wheels' names (default:"
        " %(default)s, which is not the dataset's)",
    )
    _add_motion(parser)
    wheels = parser.add_argument_group("wheels")
    wheels.add_argument(
        "--wheel-signs",
        default="1,1,1,1",
        metavar="S,S,S,S",
        help="1 or -1 for wheels 1 to 4, where rolling forward is not positive, as"
        " --wheel-signs=-1,1,-1,1",
    )
    for name, kind, default, text in (
        ("--rate-sd", real(0.0), 0.0, "[rad/s] deviation of one reading of a wheel's rate"),
        ("--radius-sd", real(0.0, 1.0), 0.01, "relative deviation of the rolling radius"),
        ("--standstill", real(0.0), 0.01, "[m/s] rim speed below which a wheel stands"),
        ("--torque-gain", real(-math.inf), None, "[N m] of a wheel for each unit of raw current"),
        ("--torque-sd", real(0.0, 1.0), 0.0, "relative deviation of that torque"),
    ):
        suffix = " (default: %(default)s)" if default is not None else " (default: no torque)"
        wheels.add_argument(name, type=kind, default=default, help=text + suffix)
    names_of = parser.add_argument_group("names and units in the file")
    names_of.add_argument(
        "--column",
        action="append",
        default=[],
        metavar="NAME=NAME_IN_THE_FILE",
        help="a column of the CSV file that has another name; repeat it",
    )
    for name in ("--rate-fields", "--current-fields"):
        text = f"fields of the encoders' message in MCAP with the four wheels' {name[2:-7]}s"
        names_of.add_argument(name, default="", metavar="FIELD,...", help=text)
    names_of.add_argument(
        "--stamps", choices=STAMPS, default="header", help="of MCAP messages (default: %(default)s)"
    )
    names_of.add_argument("--position-unit", choices=UNITS["length"], default="m")
    names_of.add_argument("--rate-unit", choices=UNITS["wheel rate"], default="rad/s")
    return parser


def _add_motion(parser: argparse.ArgumentParser) -> None:
    above = real(0.0, exclusive=True)
    motion = parser.add_argument_group("motion")
    motion.add_argument(
        "--track-width",
        type=above,
        metavar="M",
        help="[m] between the left and the right wheels' centres; needed without --straight-only",
    )
    motion.add_argument(
        "--straight-only", action="store_true", help="leave out stretches in which the rover turns"
    )
    motion.add_argument(
        "--turn-rate",
        type=above,
        default=0.05,
        metavar="RAD_S",
        help="[rad/s] yaw rate above which it turns, a mean of half a second (default:"
        " %(default)s)",
    )
    motion.add_argument(
        "--body-axes",
        default="x,z",
        metavar="FORWARD,UP",
        help="axes of the pose's frame that point forward and up (default: %(default)s)",
    )
    motion.add_argument(
        "--world-up",
        choices=AXES,
        default="z",
        help="axis of the motion capture's frame that points up (default: %(default)s)",
    )
    motion.add_argument(
        "--pose-left",
        type=real(-math.inf),
        default=0.0,
        metavar="M",
        help="[m] place of the pose's origin left of the body's middle (default: %(default)s)",
    )
    motion.add_argument(
        "--pose-ahead",
        type=real(-math.inf),
        default=0.0,
        metavar="M",
        help="[m] place of the pose's origin ahead of the body's origin, by which the lateral"
        " velocity follows in turns (default: %(default)s)",
    )
    motion.add_argument(
        "--window",
        type=real(0.02, 1.0),
        metavar="S",
        help="[s] in which a line through the poses gives the velocity (default: six poses, at"
        " least 0.1)",
    )
    motion.add_argument(
        "--position-sd",
        type=above,
        metavar="M",
        help="[m] deviation of one position (default: that by which positions miss the lines)",
    )
    motion.add_argument(
        "--pitch-sd",
        type=above,
        default=0.5,
        metavar="DEG",
        help="[deg] deviation of the pose's pitch from the body's (default: %(default)s)",
    )
    motion.add_argument(
        "--contact-angle-sd",
        type=real(0.0),
        default=0.0,
        metavar="DEG",
        help="[deg] deviation of the ground below a wheel from the plane on which the rover stands;"
        " contact angles are then 0 (default: they are not known)",
    )
    motion.add_argument(
        "--acceleration-axis",
        choices=AXES,
        default="",
        help="axis of the imu that points forward, where lin_acc is the specific force, with"
        " gravity (default: no acceleration)",
    )
    motion.add_argument(
        "--acceleration-sd",
        type=real(0.0),
        default=0.0,
        metavar="M_S2",
        help="[m/s^2] deviation of one reading",
    )


if __name__ == "__main__":
    sys.exit(main())
