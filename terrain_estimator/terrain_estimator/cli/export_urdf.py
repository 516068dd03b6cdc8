# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""export_urdf ROVER: write the URDF of a rover, for robot_state_publisher and RViz.

ROVER is a preset or the YAML file of a rover. The joints have the names and signs of joint_states.

Exit codes: 0 done; 2 the rover or the file is wrong.
"""

import sys
from pathlib import Path

from rover_parameters.records import ConfigError
from terrain_estimator.console.arguments import command_parser, real
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.files.atomic import write_file
from terrain_estimator.topics import BODY_FRAME
from terramechanics.description.urdf import to_urdf
from terramechanics.presets import load_rover

WRONG = 2


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the command."""
    parser = command_parser("export_urdf", __doc__)
    parser.add_argument("rover", help="mars_rover, for instance, or a YAML file")
    parser.add_argument("--out", type=Path, help="file (default: standard output)")
    parser.add_argument(
        "--track-width",
        type=real(0.0),
        default=0.0,
        metavar="M",
        help="[m] between left and right wheels, which the rover file lacks; as the simulator's"
        " parameter track_width (default: three quarters of the wheelbase)",
    )
    parser.add_argument(
        "--body-frame", default=BODY_FRAME, help="name of the root link (default: %(default)s)"
    )
    parser.add_argument(
        "--steered",
        action="store_true",
        help="give each wheel a joint that steers it, NAME_steering; something has to publish them,"
        " as the simulator with steering all_wheels or ackermann does",
    )
    args = parser.parse_args(argv)
    try:
        rover = load_rover(args.rover)
        text = to_urdf(
            rover,
            track_width=args.track_width,
            body_frame=args.body_frame,
            steered=rover.wheel_names if args.steered else (),
        )
        if args.out is None:
            print(text, end="")
        else:
            write_file(args.out, text)
    except (ConfigError, OSError) as error:
        print(f"export_urdf: {error}", file=sys.stderr)
        return WRONG
    return 0


if __name__ == "__main__":
    sys.exit(main())
