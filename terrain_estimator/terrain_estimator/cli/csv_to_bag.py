# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""csv_to_bag DATA.csv --mapping MAP.yaml --out BAG: convert a measured run to a bag.

The bag has the input topics of the estimator. Exit codes: 0 done; 2 wrong arguments, mapping or
data. See docs/bring_your_own_data.md.
"""

import argparse
import hashlib
import sys
from io import BufferedReader
from pathlib import Path
from typing import cast

from rover_parameters.records import ConfigError
from rover_parameters.regular_file import open_regular
from terrain_estimator.bags import BagError, whole_bag
from terrain_estimator.console.arguments import command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.printing import print_lines
from terrain_estimator.files.atomic import OutputError
from terrain_estimator.files.results import new_folder
from terrain_estimator.importing.mapping import Mapping, SignalNoise, read_mapping
from terrain_estimator.importing.messages import SampleWriter
from terrain_estimator.importing.plausibility import Plausibility
from terrain_estimator.importing.samples import CsvError, read_samples
from terrain_estimator.importing.units import UNITS, factor
from terrain_estimator.messaging.averaging import (
    FASTEST_HZ,
    SLOWEST_HZ,
    RateCounts,
    RateWindow,
    Treatment,
)
from terramechanics.presets import load_rover
from terramechanics.vehicle.rover import Rover

WRONG = 2


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Convert the file that the command line names; return the exit code."""
    options = _parser().parse_args(arguments)
    try:
        rover = load_rover(options.rover)
        mapping = _mapping(options.mapping, rover)
        text = options.mapping.read_text(encoding="utf-8")
        rows, found = convert(options.data, mapping, text, options.out, rover)
    except (ConfigError, CsvError, BagError, OutputError) as error:
        print(f"csv_to_bag: {error}", file=sys.stderr)
        return WRONG
    except OSError as error:
        print(
            f"csv_to_bag: {options.out}: the bag cannot be written: {error.strerror}",
            file=sys.stderr,
        )
        return WRONG
    notes = [f"note: {each}" for each in (*found, *_hints(mapping, rover))]
    print_lines([f"{options.out}: {rows} rows of {options.data}", *notes])
    return 0


def _mapping(path: Path, rover: Rover) -> Mapping:
    mapping = read_mapping(path)
    try:
        return mapping.completed(rover)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def convert(
    data: Path, mapping: Mapping, mapping_text: str, out: Path, rover: Rover
) -> tuple[int, list[str]]:
    """Write a bag from a CSV file; return the number of rows, and what was found about the rate.

    Raises:
        CsvError: the file is wrong, or its values are impossible on the rover; no bag is left
            behind.
        OutputError: the bag exists already or the disk is full; no bag is left behind.
    """
    found = _checked(data, mapping, rover)  # all rows, before the bag is begun
    with new_folder(out) as place, whole_bag(place) as writer:
        with open_regular(data) as file:
            digest = hashlib.file_digest(cast("BufferedReader", file), "sha256").hexdigest()
        writer.add_metadata(
            "csv_to_bag", {"file": data.name, "sha256": digest, "mapping": mapping_text}
        )
        rows = SampleWriter(writer, mapping).write_all(read_samples(data, mapping))
    return rows, found


def _checked(data: Path, mapping: Mapping, rover: Rover) -> list[str]:
    """Read all rows, judge their values and their rate; return the rate in words."""
    plausibility, window, counts = Plausibility(mapping, rover), RateWindow(), RateCounts()
    stamps = [0, 0, 0]  # number of rows, first and last stamp [ns]
    for sample in plausibility.watch(read_samples(data, mapping)):
        window.add(sample.stamp_ns)
        counts.add(window.rate)
        stamps = [stamps[0] + 1, stamps[1] if stamps[0] else sample.stamp_ns, sample.stamp_ns]
    for fault in plausibility.faults():
        raise CsvError(f"{data}: {fault}")
    found = counts.found()
    if found and all(rate.treatment is Treatment.REFUSE for rate, _ in found):
        rows, first_ns, last_ns = stamps
        mean_hz = (rows - 1) * 1e9 / (last_ns - first_ns)
        raise CsvError(f"{data}: column {mapping.time.column!r}: {_useless(mean_hz, mapping)}")
    return [
        f"{count} rows at {rate.rounded:g} Hz; replay averages them to 10 Hz, with errors taken as"
        " independent"
        if rate.treatment is Treatment.AVERAGE
        else f"{count} rows at {rate}"
        for rate, count in found
    ]


def _useless(mean_hz: float, mapping: Mapping) -> str:
    """Return why rows at this mean rate cannot be used, and the unit of time that would fit."""
    own = factor("time", mapping.time.unit)
    fitting = [
        unit
        for unit, size in UNITS["time"].items()
        if SLOWEST_HZ <= mean_hz * own / size <= FASTEST_HZ
    ]
    advice = (
        f"set time.unit: {' or '.join(fitting)} in the mapping"
        if fitting
        else "record faster, or thin the readings out"
    )
    return (
        f"the rows come at {mean_hz:.3g} Hz, but {SLOWEST_HZ:g} to {FASTEST_HZ:g} Hz are"
        f" needed: {advice}"
    )


_OF_TURNS = ("roll", "lateral_velocity", "yaw_rate")


def _hints(mapping: Mapping, rover: Rover) -> list[str]:
    hints = []
    absent = [
        signal
        for signal in ("sinkage", "torque", "acceleration", "bogie_angle")
        if not mapping.measures(signal) and (signal != "bogie_angle" or rover.suspension)
    ]
    hints += [
        f"no {signal}: every observation is refused: give its column"
        for signal in ("slip", "velocity")
        if not mapping.measures(signal)
    ]
    if absent:
        hints.append(
            f"not in the data: {', '.join(absent)}; the status of the estimates shows the"
            " consequences"
        )
    hints += [
        f"{signal}: no column for {' and '.join(names)}: without a whole axle every observation is"
        " refused"
        for signal in ("slip",)
        if mapping.measures(signal)
        for names in _unmeasured_axles(mapping, rover, signal)
    ]
    if not mapping.measures("pitch") and not mapping.constant_pitch.unit:
        hints.append(
            "no pitch: give a column, or constant_pitch if the ground was level; otherwise every"
            " observation is refused"
        )
    if not mapping.measures("contact_angle") and not mapping.constant_contact_angle.unit:
        hints.append(
            "no contact_angle: give columns, or constant_contact_angle if the ground was even, or"
            " the parameter contact_angle_sd to replay; otherwise no wheel is used"
        )
    if steered := [wheel.name for wheel in mapping.wheels if wheel.steering]:
        hints.append(
            f"steering is for a model of these wheels: model_by_wheel --steered {' '.join(steered)}"
        )
    of_turns = [each for each in _OF_TURNS if not mapping.measures(each)]
    if 0 < len(of_turns) < len(_OF_TURNS) or (steered and of_turns):
        hints.append(f"a model by wheel needs {', '.join(of_turns)}, too, which have no column")
    if mapping.measures("torque") and mapping.torque.noise != SignalNoise():
        relative, absolute = (
            mapping.torque.noise.relative,
            mapping.torque.noise.absolute * factor("torque", mapping.torque.unit),
        )
        options = f"-p torque_noise.relative:={relative:g} -p torque_noise.absolute:={absolute:g}"
        hints.append(
            "joint_states has no field for noise: give that of the torque to replay and"
            f" find_missing_effect: {options}"
        )
    return hints


def _unmeasured_axles(mapping: Mapping, rover: Rover, signal: str) -> list[list[str]]:
    """Return the wheels of each axle of which none has a column."""
    columns = {wheel.name: getattr(wheel, signal) for wheel in mapping.wheels}
    axles = [
        [wheel.name for wheel in rover.wheels if wheel.axle == axle] for axle in range(rover.axles)
    ]
    return [names for names in axles if not any(columns[name] for name in names)]


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("csv_to_bag", __doc__)
    parser.add_argument(
        "data",
        type=Path,
        metavar="DATA.csv",
        help="one row for each sample; the first row names the columns",
    )
    parser.add_argument(
        "--mapping", type=Path, required=True, metavar="MAP.yaml", help="meaning of the columns"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="BAG", help="folder of the bag, must not exist"
    )
    parser.add_argument(
        "--rover",
        default="mars_rover",
        metavar="ROVER",
        help="name or file of the rover, whose wheels and size the data are checked against"
        " (default: %(default)s)",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
