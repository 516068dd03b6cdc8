# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""export_core MODEL FOLDER: write a model as plain C++ that needs neither torch nor ROS.

The folder has the source, its C header, a CMakeLists.txt, a test of it, and the statics of the
planner. --build puts a compiled core and the statics beside the model, where the nodes find them,
and the rover's reference drives where the model has none.

Exit codes: 0 done; 2 the model cannot be written as C++, or the folder is not empty.
"""

import shutil
import sys
from pathlib import Path

from terrain_estimator.compiled.folder import BuildError, build_core, flags_by_end, write_core
from terrain_estimator.compiled.graphs import UntranslatableError
from terrain_estimator.console.arguments import command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.learning.reference_drives import measured_drives
from terrain_estimator.model.metadata import ModelFileError, model_path, read_metadata
from terrain_estimator.offline.reference_drives import ENDING as DRIVE
from terrain_estimator.offline.reference_drives import reference_drives, write_drives
from terrain_estimator.planning.solving import solve_statics
from terrain_estimator.planning.statics import ENDING, write_statics

WRONG = 2


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the command."""
    parser = command_parser("export_core", __doc__)
    parser.add_argument("model", help="path of a .pt file, or the name of an installed model")
    parser.add_argument("folder", type=Path, help="new or empty folder")
    parser.add_argument(
        "--build", action="store_true", help="compile it, too, into a library beside the model"
    )
    args = parser.parse_args(argv)
    try:
        if args.folder.exists() and any(args.folder.iterdir()):
            return _refuse(f"{args.folder}: not empty: give a new folder")
        model = model_path(args.model)
        write_core(model, args.folder)
        metadata = read_metadata(model.with_suffix(".json"))
        statics = args.folder / (model.stem + ENDING)
        write_statics(
            statics,
            solve_statics(metadata.rover, metadata.soils, metadata.wheel_places),
            metadata.sha256,
        )
        if args.build:
            shutil.copyfile(statics, model.with_name(statics.name))
            if not reference_drives(model, metadata):
                drives = measured_drives(metadata)
                write_drives(model.with_name(model.stem + DRIVE), metadata, drives)
            for end, flags in flags_by_end().items():
                build_core(args.folder, model.with_suffix(end), *flags)
    except (ModelFileError, UntranslatableError, BuildError, OSError) as error:
        return _refuse(str(error))
    print(f"{args.folder}: {model.name} as C++")
    return 0


def _refuse(why: str) -> int:
    print(f"export_core: {why}", file=sys.stderr)
    return WRONG


if __name__ == "__main__":
    sys.exit(main())
