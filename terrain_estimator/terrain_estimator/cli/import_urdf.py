# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""import_urdf FILE: write the rover file of a rover from its URDF.

Wheels, axles, bogie, mass and centre of mass come from the URDF; expand xacro first. It also says
what model_by_wheel needs beside the rover file. Needs yourdfpy.

Exit codes: 0 done; 2 the URDF or a file is wrong, or the rover is of no kind that is supported.
"""

import math
import sys
from pathlib import Path

from rover_parameters.records import ConfigError, build
from terrain_estimator.console.arguments import command_parser, real
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.files.atomic import write_file
from terrain_estimator.importing.urdf import Given, read_urdf, rover_of_urdf, rover_yaml
from terrain_estimator.topics import BODY_FRAME
from terramechanics.vehicle.rover import Rover

WRONG = 2


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the command."""
    parser = command_parser("import_urdf", __doc__)
    parser.add_argument("urdf", type=Path, help="URDF file, without xacro")
    parser.add_argument("--out", type=Path, required=True, help="rover file to write (YAML)")
    parser.add_argument(
        "--body-frame", default=BODY_FRAME, help="link of the body (default: %(default)s)"
    )
    parser.add_argument(
        "--gravity", type=real(0.0), default=9.81, help="[m/s^2] (default: %(default)s)"
    )
    parser.add_argument(
        "--cruise-speed",
        type=real(0.0),
        nargs=2,
        default=(0.1, 0.3),
        metavar=("LOW", "HIGH"),
        help="[m/s] of simulated drives (default: 0.1 0.3)",
    )
    parser.add_argument(
        "--mass", type=real(0.0), default=math.nan, help="[kg] instead of the sum of the links'"
    )
    parser.add_argument(
        "--centre-of-mass",
        type=real(-math.inf),
        nargs=2,
        default=(math.nan, math.nan),
        metavar=("X", "HEIGHT"),
        help="[m] along the body and above the ground, instead of the URDF's",
    )
    parser.add_argument(
        "--wheel-inertia",
        type=real(0.0),
        default=math.nan,
        help="[kg m^2] of a wheel with its drive, instead of the URDF's",
    )
    args = parser.parse_args(argv)
    given = Given(
        args.body_frame,
        args.gravity,
        tuple(args.cruise_speed),
        args.mass,
        tuple(args.centre_of_mass),
        args.wheel_inertia,
    )
    if args.out.exists():
        return _refuse(f"{args.out} is there already: give a new file")
    try:
        found = rover_of_urdf(read_urdf(args.urdf), given)
        rover = build(Rover, found.content, str(args.urdf))
        write_file(args.out, rover_yaml(found, args.urdf.name))
    except (ConfigError, OSError) as error:
        return _refuse(str(error))
    steered = f" --steered {' '.join(found.steered)}" if found.steered else ""
    print(f"{args.out}: {rover.axles} axles, wheels {', '.join(rover.wheel_names)}")
    print(f"model_by_wheel takes --track-width {found.track_width:g}{steered}")
    return 0


def _refuse(why: str) -> int:
    print(f"import_urdf: {why}", file=sys.stderr)
    return WRONG


if __name__ == "__main__":
    sys.exit(main())
