# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""model_by_wheel: write the model of a rover that turns, whose wheels are estimated one by one.

It is the rover's physics alone, so that nothing is trained. The estimator takes it as any model and
then uses turns, cross slopes, skid steering and backing out, where a model by axle refuses them.
It needs lateral velocity, yaw rate and roll, and rate and torque of every wheel; sinkages where
balances do not tell them. Beside it lie reference drives of the rover, by which the estimator
judges its sensors.

Exit codes: 0 written and checked; 2 an argument, rover or soil file is wrong.
"""

import dataclasses
import sys
from argparse import Namespace
from pathlib import Path

import torch

from rover_parameters.records import ConfigError
from terrain_estimator.cli.ground_option import ON_VARYING_GROUND, add_ground_variation
from terrain_estimator.compiled.source import watched_drive
from terrain_estimator.console.arguments import command_parser, real
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.learning.by_wheel import build_model_by_wheel
from terrain_estimator.learning.export import check_export, export
from terrain_estimator.learning.reference_drives import measured_drives
from terrain_estimator.model.metadata import ModelFileError, Training
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terrain_estimator.offline.reference_drives import ENDING as DRIVE
from terrain_estimator.offline.reference_drives import write_drives
from terramechanics.presets import load_rover, load_soil
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces

WRONG = 2
EVERY = "all"
_CHECKED = 50  # observations


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Run the command."""
    torch.set_num_threads(1)
    parser = command_parser("model_by_wheel", __doc__)
    parser.add_argument("--rover", required=True, help="name or YAML file of the rover")
    parser.add_argument(
        "--soil", nargs="+", required=True, help="names or YAML files of the soils in the model"
    )
    parser.add_argument(
        "--track-width",
        type=real(0.0, exclusive=True),
        required=True,
        metavar="M",
        help="[m] between the middles of left and right wheels, which the rover file lacks",
    )
    parser.add_argument(
        "--steered",
        nargs="+",
        default=[],
        metavar="WHEEL",
        help="names of the wheels that are steered, or all; joint_states has to have the angle of"
        " a joint NAME_steering for each (default: none, as of a skid-steer)",
    )
    parser.add_argument(
        "--yaw-inertia",
        type=real(0.0, exclusive=True),
        metavar="I",
        help="[kg m^2] of the rover about the vertical (default: its mass spread evenly between"
        " the wheels)",
    )
    parser.add_argument(
        "--constants-sd",
        type=real(0.0, 0.2),
        default=DEFAULT_PRIOR.constants_sd,
        help="relative deviation of each soil constant; 0: exact (default: %(default)s)",
    )
    add_ground_variation(parser, "wheel")
    parser.add_argument(
        "--torque-gain-sd",
        type=real(0.0, 0.5),
        default=0.0,
        metavar="SD",
        help="relative deviation of a gain that all torques share, as of a motor constant, which is"
        " then estimated; needs every sinkage (default: %(default)s, torques are calibrated)",
    )
    parser.add_argument(
        "--torque-friction-sd",
        type=real(0.0),
        default=0.0,
        metavar="SD",
        help="[N m] deviation of the friction between motor and wheel that all share, beside"
        " --torque-gain-sd (default: %(default)s)",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/models"), help="folder of the model files"
    )
    args = parser.parse_args(argv)
    try:
        path = write(args, load_rover(args.rover))
    except (ConfigError, ModelFileError, OSError) as error:
        print(f"model_by_wheel: {error}", file=sys.stderr)
        return WRONG
    print(f"{path}: a model by wheel; the estimator takes it by -p model:={path}")
    return 0


def write(args: Namespace, rover: Rover) -> Path:
    """Write and check the model that the arguments ask for; return its path.

    Raises:
        ConfigError: rover, soil or wheels are wrong.
        ModelFileError: the file differs from the model.
        OSError: it cannot be written.
    """
    steered = rover.wheel_names if args.steered == [EVERY] else tuple(args.steered)
    torque_sd = (args.torque_gain_sd, args.torque_friction_sd)
    if torque_sd[1] and not torque_sd[0]:
        raise ConfigError("--torque-friction-sd needs --torque-gain-sd: give both")
    places = WheelPlaces.of(rover, args.track_width, steered)
    if args.yaw_inertia is not None:
        places = dataclasses.replace(places, yaw_inertia=args.yaw_inertia)
    soils = [load_soil(name) for name in args.soil]
    for soil in soils:
        soil.for_wheel(rover.wheel_width)
    prior = dataclasses.replace(
        DEFAULT_PRIOR, constants_sd=args.constants_sd, ground_variation=args.ground_variation
    )
    model = build_model_by_wheel(rover, places, soils, prior, tuple(filter(None, torque_sd)))
    name = f"{rover.name}_by_wheel{ON_VARYING_GROUND if args.ground_variation else ''}"
    folder = ResultFolder(args.out)
    with folder.renewing(f"{name}.pt", f"{name}.json", f"{name}{DRIVE}") as new:
        nothing_learnt = Training(seed=0, iterations=0, loss=0.0, torch_version=torch.__version__)
        metadata = export(model, rover, soils, nothing_learnt, new / f"{name}.pt", places)
        check_export(model, new / f"{name}.pt", watched_drive(metadata)[:_CHECKED])
        write_drives(new / f"{name}{DRIVE}", metadata, measured_drives(metadata))
    return Path(args.out, f"{name}.pt")


if __name__ == "__main__":
    sys.exit(main())
