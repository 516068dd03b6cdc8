# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``train``: simulate drives, train the learnt features, export the model, check the file against the model."""

import argparse
import dataclasses
import sys
from pathlib import Path

import matplotlib as mpl
import torch

from terrain_estimator.cli.progress import ProgressReport
from terrain_estimator.learning.export import check_export, export
from terrain_estimator.learning.tasks import draw_tasks
from terrain_estimator.learning.training import Progress, Recipe, build_model, train
from terrain_estimator.model_file import MODELS, ModelFileError, Training
from terramechanics.loading import ConfigError
from terramechanics.rover import Rover, load_rover
from terramechanics.soil import Soil, load_soil

_CHECKED_OBSERVATIONS = 50
_SMOOTHED = 20  # iterations in the loss that the metadata state


def main(argv: list[str] | None = None) -> int:
    """Entry point. 0: trained and checked; 2: an argument, rover or soil file is wrong, or the export differs."""
    torch.set_num_threads(1)
    args = _parser().parse_args(argv)
    if args.tasks < Recipe().batch or args.iterations < 1:
        sys.stderr.write(f"train: --tasks {args.tasks} --iterations {args.iterations}: give at least {Recipe().batch} and 1\n")
        return 2
    try:
        for rover_name in args.rover:
            for soil_name in args.soil:
                _train_one(load_rover(rover_name), load_soil(soil_name), args)
    except (ConfigError, ModelFileError, OSError) as error:
        sys.stderr.write(f"train: {error}\n")
        return 2
    return 0


def _parser() -> argparse.ArgumentParser:
    recipe = Recipe()
    parser = argparse.ArgumentParser(prog="train", description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("--rover", nargs="+", default=["mars_rover", "paper_rover"], help="names or YAML files of rovers")
    parser.add_argument("--soil", nargs="+", default=["loose_sand"], help="names or YAML files of soils")
    parser.add_argument("--out", type=Path, default=MODELS, help="folder of the model files")
    parser.add_argument("--curves", type=Path, default=Path("out/train"), help="folder of the pictures of the training")
    parser.add_argument("--seed", type=int, default=recipe.seed, help="of everything that is drawn")
    parser.add_argument("--iterations", type=int, default=recipe.iterations, help="training iterations")
    parser.add_argument("--tasks", type=int, default=recipe.tasks, help="simulated drives")
    return parser


def _train_one(rover: Rover, soil: Soil, args: argparse.Namespace) -> None:
    recipe = dataclasses.replace(Recipe(), seed=args.seed, iterations=args.iterations, tasks=args.tasks)
    model = build_model(rover, soil, recipe.columns, recipe.hidden)
    name = f"{rover.name}-{soil.name}"
    history: list[Progress] = []
    with ProgressReport(f"{name}: simulating {recipe.tasks} drives, training") as report:
        for progress in train(model, rover, soil, recipe):
            history.append(progress)
            report.at((progress.iteration + 1) / recipe.iterations, f"loss {progress.loss:.3f}")
    tail = [progress.loss for progress in history[-_SMOOTHED:]]
    training = Training(recipe.seed, recipe.iterations, sum(tail) / len(tail), torch.__version__)
    path = args.out / f"{name}.pt"
    metadata = export(model, rover, soil, training, path)
    fresh = draw_tasks(rover, soil, "S1", _CHECKED_OBSERVATIONS / 10, 1, torch.Generator().manual_seed(recipe.seed + 1))
    check_export(model, path, fresh.measured[0])
    curves = args.curves / f"{name}.png"
    draw_curves(history, curves, name)
    sys.stdout.write(f"{path}: {metadata.size} bytes, loss {training.loss:.3f} nat a row, curves in {curves}\n")


def draw_curves(history: list[Progress], path: Path, title: str) -> None:
    """Loss and overlap over the iterations, as a PNG."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415 (after the choice of a backend without display)

    figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(7, 5), layout="constrained")
    steps = [progress.iteration for progress in history]
    upper.plot(steps, [progress.loss for progress in history], linewidth=0.8)
    upper.axhline(1.419, color="grey", linestyle=":", label="unit noise alone: (1 + log 2 pi) / 2")
    upper.set(ylabel="loss [nat per row]", title=title, ylim=(1.3, 2.5))
    upper.legend()
    lower.semilogy(steps, [progress.overlap for progress in history], linewidth=0.8)
    lower.set(ylabel="overlap with physics [1]", xlabel="iteration")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    sys.exit(main())
