# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""csv_to_bag DATA.csv --mapping MAP.yaml --out BAG: convert a measured run to a bag.

The bag has the input topics of the estimator. Exit codes: 0 done; 2 wrong arguments, mapping or
data. See docs/bring_your_own_data.md.
"""

import argparse
import hashlib
import sys
from collections import deque
from pathlib import Path

from rover_parameters.records import ConfigError
from terrain_estimator.bags import BagError, whole_bag
from terrain_estimator.console.arguments import command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.files.atomic import OutputError
from terrain_estimator.files.results import new_folder
from terrain_estimator.importing.mapping import Mapping, SignalNoise, read_mapping
from terrain_estimator.importing.messages import SampleWriter
from terrain_estimator.importing.samples import CsvError, read_samples
from terrain_estimator.importing.units import factor

WRONG = 2


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Convert the file that the command line names; return the exit code."""
    options = _parser().parse_args(arguments)
    try:
        mapping = read_mapping(options.mapping)
        rows, hints = convert(
            options.data, mapping, options.mapping.read_text(encoding="utf-8"), options.out
        )
    except (ConfigError, CsvError, BagError, OutputError) as error:
        print(f"csv_to_bag: {error}", file=sys.stderr)
        return WRONG
    except OSError as error:
        print(
            f"csv_to_bag: {options.out}: the bag cannot be written: {error.strerror}",
            file=sys.stderr,
        )
        return WRONG
    print(f"{options.out}: {rows} rows of {options.data}")
    for hint in hints:
        print(f"note: {hint}")
    return 0


def convert(data: Path, mapping: Mapping, mapping_text: str, out: Path) -> tuple[int, list[str]]:
    """Write a bag from a CSV file; return the number of rows, and hints for the user.

    Raises:
        CsvError: the file is wrong; no bag is left behind.
        OutputError: the bag exists already or the disk is full; no bag is left behind.
    """
    deque(read_samples(data, mapping), maxlen=0)  # check all rows before the bag is begun
    with new_folder(out) as place, whole_bag(place) as writer:
        with data.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        writer.add_metadata(
            "csv_to_bag", {"file": data.name, "sha256": digest, "mapping": mapping_text}
        )
        rows = SampleWriter(writer, mapping).write_all(read_samples(data, mapping))
    return rows, _hints(mapping)


def _hints(mapping: Mapping) -> list[str]:
    hints = []
    absent = [
        signal
        for signal in ("slip", "sinkage", "velocity", "torque", "acceleration", "bogie_angle")
        if not mapping.measures(signal)
    ]
    if absent:
        hints.append(
            f"not in the data: {', '.join(absent)}; the status of the estimates shows the"
            " consequences"
        )
    if not mapping.measures("pitch") and not mapping.constant_pitch.unit:
        hints.append(
            "no pitch: give a column, or constant_pitch if the ground was level; otherwise every"
            " observation is refused"
        )
    if not mapping.measures("contact_angle") and not mapping.constant_contact_angle.unit:
        hints.append(
            "no contact_angle: give columns, or constant_contact_angle if the ground was even;"
            " otherwise no wheel is used"
        )
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
    return parser


if __name__ == "__main__":
    sys.exit(main())
