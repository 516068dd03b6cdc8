# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""train: export the model of a rover on soils, and check the file.

The model is the physics of rover and soils, which takes seconds. Beside it lie reference drives of
the rover, by which the estimator judges its sensors. With --columns it has learnt
features, too: drives are simulated and a net is trained on them, in one and a half minutes of
processor time. Its file is called ROVER_with_net.
"""

import argparse
import dataclasses
import itertools
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import torch

from rover_parameters.records import ConfigError
from terrain_estimator.cli.ground_option import ON_VARYING_GROUND, add_ground_variation
from terrain_estimator.console.arguments import COUNT, SEED, WORKERS, real, whole
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.learning.curves import draw_curves
from terrain_estimator.learning.departures import HIDDEN
from terrain_estimator.learning.export import check_export, export
from terrain_estimator.learning.generation import Chunk, Order, Spread, generate
from terrain_estimator.learning.loss import Orthogonality
from terrain_estimator.learning.reference_drives import measured_drives
from terrain_estimator.learning.regression import Regression
from terrain_estimator.learning.tasks import BENCHMARK, PAPER, ROVERS, SOILS, draw_tasks
from terrain_estimator.learning.training import Progress, Recipe, build_model, train
from terrain_estimator.model.metadata import (
    VELOCITY_ALONE,
    Metadata,
    ModelFileError,
    Training,
)
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.prior import DEFAULT_PRIOR, Prior
from terrain_estimator.offline.cluster import cluster
from terrain_estimator.offline.reference_drives import ENDING as DRIVE
from terrain_estimator.offline.reference_drives import write_drives
from terramechanics.presets import load_rover, load_soil
from terramechanics.terrain.soil import Soil
from terramechanics.vehicle.rover import Rover

_ENDINGS = (".pt", ".json", DRIVE)
"""Endings of the files of a model: module, description, reference drives."""
_CHECKED_OBSERVATIONS = 50
_SMOOTHED = 20  # iterations behind the loss in the metadata
_LARGEST_CONSTANTS_SD = 0.2  # of the soil's value: beyond it, columns are far from linear
_FEW = 1000
"""Number of drives up to which this process draws them alone.

Starting two workers takes as long as 150 drives.
"""
_ELSEWHERE = ("rover", "soil", "out", "curves", "scheduler", "workers")
"""Arguments that name places: they do not change the model, or are the metadata's own fields."""
_WITH_NET = "_with_net"
"""End of the name of a model that has learnt features."""
_VELOCITY_ALONE = "_velocity_alone"
"""End of the name of a model whose velocity row alone counts."""
_ALL, _VELOCITY = "all", "velocity"
_ROWS = {_ALL: (), _VELOCITY: VELOCITY_ALONE}
"""Rows that count, by the value of ``--rows``."""
_OF_PHYSICS = ("columns", "constants_sd", "ground_variation", "rows")
"""Arguments that change a model without learnt features."""
_OF_ANY = (*_OF_PHYSICS, "rover", "soil", "out", "curves", "seed", "device")
"""Arguments that may be given without learnt features."""
_STRENGTHS = {"benchmark": BENCHMARK, "paper": PAPER}


class DeviceError(ValueError):
    """The requested device does not exist."""


@interruptible
def main(argv: list[str] | None = None) -> int:
    """Make the models that the command line asks for; return the exit code.

    0: made and checked; 2: an argument, rover or soil file is wrong, or the export differs.
    """
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    if not 0.0 <= args.constants_sd < _LARGEST_CONSTANTS_SD:
        sys.stderr.write(
            f"train: --constants-sd {args.constants_sd:g}: give 0 to {_LARGEST_CONSTANTS_SD:g},"
            " exclusive\n"
        )
        return 2
    try:
        check_needed(args)
        check_rows(args)
        device = choose_device(args.device)
        rovers, soils = (
            [load_rover(name) for name in args.rover],
            [load_soil(name) for name in args.soil],
        )
        for rover, soil in itertools.product(rovers, soils):
            soil.for_wheel(rover.wheel_width)
        end = _WITH_NET if args.columns else ""
        end += ON_VARYING_GROUND if args.ground_variation else ""
        end += _VELOCITY_ALONE if args.rows == _VELOCITY else ""
        names = [name + end for name in file_names(rovers, soils)]
        models, curves = ResultFolder(args.out), ResultFolder(args.curves)
        models.check(*(f"{name}{ending}" for name in names for ending in _ENDINGS))
        if args.columns:
            curves.check(*(f"{name}.png" for name in names))
        for rover, name in zip(rovers, names, strict=True):
            if args.columns:
                model, training, history = _trained(rover, soils, name, args, device)
            else:
                model, training, history = _physics(rover, soils, args)
            metadata = _write(model, rover, soils, training, models, name)
            sys.stdout.write(f"{args.out / name}.pt: {metadata.size} bytes\n")
            if history:
                with curves.renewing(f"{name}.png") as new:
                    draw_curves(history, new / f"{name}.png", name)
                sys.stdout.write(
                    f"{args.curves / name}.png: loss, at last {training.loss:.3f} nat a row\n"
                )
    except (ConfigError, ModelFileError, OSError, ValueError) as error:
        sys.stderr.write(f"train: {error}\n")
        return 2
    return 0


def check_needed(args: argparse.Namespace) -> None:
    """Raise ConfigError where an argument of the training is given and nothing is trained."""
    if args.columns:
        return
    usual = vars(_parser().parse_args([]))
    for name, value in vars(args).items():
        if name not in _OF_ANY and value != usual[name]:
            raise ConfigError(
                f"--{name.replace('_', '-')} {value}: without --columns nothing is trained: give"
                " --columns 6 for a model with a net, or leave this out"
            )


def check_rows(args: argparse.Namespace) -> None:
    """Raise ConfigError where an argument contradicts ``--rows velocity``, or say what it does."""
    if args.rows != _VELOCITY:
        return
    for option, value, why in (
        ("--columns", args.columns, "its net would be trained by rows that do not count"),
        ("--ground-variation", args.ground_variation, "not known for the velocity alone"),
    ):
        if value:
            raise ConfigError(f"{option} {value:g} with --rows {_VELOCITY}: {why}: give 0")
    if len(args.soil) > 1:
        raise ConfigError(
            f"--soil {' '.join(args.soil)} with --rows {_VELOCITY}: the velocity alone does not"
            " tell soils apart: give one"
        )
    if args.constants_sd:
        sys.stderr.write(
            f"train: note: --rows {_VELOCITY} with --constants-sd {args.constants_sd:.3g}: the"
            " velocity alone does not tell soil constants from the ground, and the intervals of c"
            " and tan phi are too narrow: give 0 where the constants are exact, as those of a"
            " simulation\n"
        )


def file_names(rovers: Sequence[Rover], soils: Sequence[Soil]) -> list[str]:
    """Return the names of the models' files, without an ending.

    Raises ConfigError where two would be the same, or a name is no file name.
    """
    called = [soil.name for soil in soils]
    if twice := next((name for name in called if called.count(name) > 1), ""):
        raise ConfigError(
            f"two soils are called {twice}: a model identifies its soils by name, rename one"
            " in its file"
        )
    names = [rover.name if len(soils) > 1 else f"{rover.name}-{called[0]}" for rover in rovers]
    for name in names:
        if names.count(name) > 1:
            raise ConfigError(
                f"two rovers are called {name}, and so would be their models: rename one in its"
                " file"
            )
        if Path(name).name != name:
            raise ConfigError(
                f"{name} cannot be the name of a model file: use names of rover and soil without"
                " slashes"
            )
    return names


def choose_device(name: str) -> torch.device:
    """Return the device of a training: ``auto`` is the GPU where there is one.

    Raises DeviceError.
    """
    there = torch.cuda.is_available()
    if name == "cuda" and not there:
        raise DeviceError(
            "--device cuda: torch finds no GPU; install its CUDA build (docs/installation.md), or"
            " give --device cpu"
        )
    return torch.device("cuda" if there and name != "cpu" else "cpu")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="train", description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    recipe = Recipe()
    parser.add_argument(
        "--rover", nargs="+", default=list(ROVERS), help="names or YAML files of rovers"
    )
    parser.add_argument(
        "--soil",
        nargs="+",
        default=list(SOILS),
        help="names or YAML files of the soils in the model",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/models"),
        help="folder of the model files, new or of earlier trainings",
    )
    parser.add_argument(
        "--curves",
        type=Path,
        default=Path("out/train"),
        help="folder of the training curves",
    )
    parser.add_argument("--seed", type=SEED, default=recipe.seed, help="seed of all random numbers")
    _add_drives(parser, recipe)
    _add_training(parser, recipe)
    return parser


def _add_drives(parser: argparse.ArgumentParser, recipe: Recipe) -> None:
    parser.add_argument(
        "--tasks",
        type=whole(recipe.batch),
        default=400,
        help="number of simulated drives, divided among the soils",
    )
    parser.add_argument(
        "--strength",
        choices=_STRENGTHS,
        default="benchmark",
        help="source of c and phi of the drives",
    )
    parser.add_argument(
        "--hidden-effects",
        type=real(0.0, 1.0),
        default=HIDDEN,
        help="share of the drives with each effect that the physics lacks",
    )
    parser.add_argument(
        "--scheduler",
        default="",
        help="address of a dask.distributed scheduler for the drives; default: this machine",
    )
    parser.add_argument(
        "--workers",
        type=WORKERS,
        default=0,
        help="processes on this machine for the drives; 0: one, or one for each CPU if many",
    )


def _add_training(parser: argparse.ArgumentParser, recipe: Recipe) -> None:
    parser.add_argument(
        "--device",
        choices=("auto", "cpu", "cuda"),
        default="auto",
        help="device that trains the net; auto: a GPU where there is one",
    )
    parser.add_argument(
        "--iterations",
        type=COUNT,
        default=recipe.iterations,
        help="training iterations of 20 drives",
    )
    parser.add_argument(
        "--columns",
        type=whole(0),
        default=0,
        help="learnt features; 0: none, and nothing is trained; the nets that ship have 6",
    )
    parser.add_argument(
        "--hidden", type=COUNT, default=recipe.hidden, help="width of the two hidden layers"
    )
    parser.add_argument(
        "--constants-sd",
        type=float,
        default=DEFAULT_PRIOR.constants_sd,
        help="relative deviation of each soil constant; 0: exact",
    )
    add_ground_variation(parser, "axle")
    parser.add_argument(
        "--rows",
        choices=_ROWS,
        default=_ALL,
        help="regression rows that count; velocity: that row alone, for data whose sinkages follow"
        " from no balance of the load",
    )
    parser.add_argument(
        "--orthogonality",
        choices=[penalty.name.lower() for penalty in Orthogonality],
        default=recipe.orthogonality.name.lower(),
        help="kind of the penalty",
    )
    parser.add_argument(
        "--caution",
        type=real(0.0, exclusive=True),
        default=recipe.caution,
        help="divisor of the learnt deviations of the net's weights",
    )
    parser.add_argument(
        "--orthogonality-strength", type=real(0.0), default=recipe.strength, help="its weight"
    )


def recipe_of(args: argparse.Namespace) -> Recipe:
    """Return the recipe that the arguments ask for."""
    return dataclasses.replace(
        Recipe(),
        seed=args.seed,
        iterations=args.iterations,
        columns=args.columns,
        hidden=args.hidden,
        orthogonality=Orthogonality[args.orthogonality.upper()],
        strength=args.orthogonality_strength,
        caution=args.caution,
    )


def options_of(args: argparse.Namespace, device: torch.device) -> tuple[str, ...]:
    """Return the options that repeat this training, defaults included.

    The file holds rover and soils separately.
    """
    effective = vars(args) | {"device": device.type}
    return written({name: value for name, value in effective.items() if name not in _ELSEWHERE})


def written(options: dict[str, object]) -> tuple[str, ...]:
    """Return options as the command line takes them; ``--rows`` only where not all count."""
    return tuple(
        f"--{name.replace('_', '-')}={value}"
        for name, value in sorted(options.items())
        if (name, value) != ("rows", _ALL)
    )


def _prior(args: argparse.Namespace) -> Prior:
    """Return the prior that the arguments ask for."""
    return dataclasses.replace(
        DEFAULT_PRIOR, constants_sd=args.constants_sd, ground_variation=args.ground_variation
    )


def _physics(
    rover: Rover, soils: list[Soil], args: argparse.Namespace
) -> tuple[PAlpaca, Training, list[Progress]]:
    """Return the model without learnt features, of which nothing is trained."""
    prior = _prior(args)
    own = {name: value for name, value in vars(args).items() if name in _OF_PHYSICS}
    training = Training(args.seed, 0, 0.0, torch.__version__, written(own))
    model = build_model(rover, soils, prior=prior, used_rows=_ROWS[args.rows])
    return model, training, []


def _trained(
    rover: Rover, soils: list[Soil], name: str, args: argparse.Namespace, device: torch.device
) -> tuple[PAlpaca, Training, list[Progress]]:
    """Draw the drives and train a model on them."""
    recipe = recipe_of(args)
    orders = [
        Order(
            rover,
            soil,
            drives,
            args.seed,
            strength=_STRENGTHS[args.strength],
            share=args.hidden_effects,
            constants_sd=args.constants_sd,
        )
        for soil, drives in zip(soils, shared_out(args.tasks, len(soils)), strict=True)
    ]
    data = Regression.join([draw(order, args.scheduler, args.workers) for order in orders])
    prior = _prior(args)
    model = build_model(rover, soils, recipe.columns, recipe.hidden, prior)
    history: list[Progress] = []
    with ProgressReport(f"{name}: training on {device}") as report:
        for progress in train(model, data, recipe, device):
            history.append(progress)
            report.at((progress.iteration + 1) / recipe.iterations, f"loss {progress.loss:.3f}")
    tail = [progress.loss for progress in history[-_SMOOTHED:]]
    training = Training(
        recipe.seed,
        recipe.iterations,
        sum(tail) / len(tail),
        torch.__version__,
        options_of(args, device),
    )
    return model, training, history


def _write(
    model: PAlpaca,
    rover: Rover,
    soils: list[Soil],
    training: Training,
    models: ResultFolder,
    name: str,
) -> Metadata:
    """Export a model with its reference drives; one that fails the check replaces no other."""
    fresh = draw_tasks(
        rover,
        soils[0],
        "S1",
        _CHECKED_OBSERVATIONS / 10,
        1,
        torch.Generator().manual_seed(training.seed + 1),
    )
    with models.renewing(*(f"{name}{ending}" for ending in _ENDINGS)) as new:
        metadata = export(model, rover, soils, training, new / f"{name}.pt")
        check_export(model, new / f"{name}.pt", fresh.measured[0])
        write_drives(new / f"{name}{DRIVE}", metadata, measured_drives(metadata))
    return metadata


def shared_out(total: int, parts: int) -> list[int]:
    """Divide a total into whole numbers that are as equal as possible."""
    return [total * (part + 1) // parts - total * part // parts for part in range(parts)]


def draw(order: Order, scheduler: str, workers: int) -> Regression:
    """Draw the drives of an order, on a cluster where one is named or where there are many."""
    with ProgressReport(
        f"{order.rover.name}-{order.soil.name}: simulating {order.drives} drives"
    ) as report:

        def watched(spread: Spread) -> Spread:
            def told(
                function: Callable[[Chunk], Regression], chunks: Sequence[Chunk]
            ) -> Iterator[Regression]:
                for index, piece in enumerate(spread(function, chunks)):
                    report.at((index + 1) / len(chunks))
                    yield piece

            return told

        if not scheduler and workers < 2 and (workers == 1 or order.drives <= _FEW):
            return generate(order, watched(map))
        with cluster(scheduler, workers or None) as spread:
            return generate(order, watched(spread))


if __name__ == "__main__":
    sys.exit(main())
