# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""replay BAG...: estimate from recordings without ROS, by the same code as the live node.

Exit codes: 0 done; 1 the comparison with the live estimates found a difference; 2 wrong arguments,
parameters, model or bag; 3 a bag gave no estimate.
"""

import argparse
import sys
from pathlib import Path

import torch

from rover_parameters.parameters import template
from rover_parameters.records import ConfigError
from terrain_estimator.bags import BagError, bag_name
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.console.arguments import command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.estimator.saved_state import StateFileError
from terrain_estimator.estimator.summary import Beliefs
from terrain_estimator.messaging.pipeline import rover_of
from terrain_estimator.model.model_file import LoadedModel, ModelFileError, load_model
from terrain_estimator.offline.bag_options import add_options, node_config
from terrain_estimator.offline.replay import Replay, Start, compare_with_live, replay
from terrain_estimator.offline.summary import print_table, summary, write_summary
from terrain_estimator.offline.topic_mapping import TopicError, absolute, bag_topics

DIFFERENT, WRONG, NOTHING = 1, 2, 3


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Replay the bags that the command line names; return the exit code."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if not (options.bags or options.dump_config):
        parser.error("no bag is named: give the folder of a recording")
    torch.set_num_threads(1)  # as in the live node: the order of a sum is part of its result
    try:
        parameters = node_config(options, **({"model": options.model} if options.model else {}))
        config = parameters.estimator
        if options.dump_config:
            print(template(absolute("estimator", options.namespace), parameters))
            return 0
        model = load_model(config.model)
        names = bag_topics(options.remap, options.namespace)
        rover_of(model, config.rover)
        Beliefs.of(model.metadata, config.core)
        start = Start.read(options.state, model.sha256) if options.state else None
    except (ModelFileError, ConfigError, TopicError, StateFileError) as error:
        return _refuse(str(error))
    return _replay_all(options, model, config, names, start)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("replay", __doc__)
    parser.add_argument(
        "bags",
        nargs="*",
        type=Path,
        metavar="BAG",
        help="folder of a bag or bare .mcap file, finished or not",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/replay"),
        help="folder for estimates bags and summary.json (default: %(default)s)",
    )
    parser.add_argument(
        "--model",
        default="",
        help="name of an installed model or path of a model file (default: mars_rover)",
    )
    add_options(parser)
    parser.add_argument(
        "--dump-config",
        action="store_true",
        help="print the parameters in force as a parameter file, and exit",
    )
    parser.add_argument(
        "--report",
        type=Path,
        metavar="FILE.html",
        help="write a page about the runs: one HTML file",
    )
    parser.add_argument(
        "--state",
        type=Path,
        metavar="FILE",
        help="start from this saved state, like a node that continued from it",
    )
    parser.add_argument(
        "--compare",
        action="store_true",
        help="compare with the estimates of the live node in the bag",
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="replace estimates bags of an earlier replay"
    )
    return parser


def _replay_all(
    options: argparse.Namespace,
    model: LoadedModel,
    config: EstimatorConfig,
    names: dict[str, str],
    start: Start | None,
) -> int:
    """Replay one bag after the other, each from the same start.

    A bag that fails does not stop the others.
    """
    replays: list[Replay] = []
    failed = False
    for bag in options.bags:
        try:
            output = options.out / f"{bag_name(bag)}_estimates"
            _make_room(
                output, [each.estimates_bag for each in replays], overwrite=options.overwrite
            )
            replays.append(replay(bag, output, model, config, names, start))
            if options.compare:
                compare_with_live(replays[-1], names)
        except (BagError, TopicError, StateFileError, OSError) as error:
            failed = True
            _refuse(str(error))
    if replays:
        print_table(replays)
        failed |= not _summary(options.out / "summary.json", replays, model, config)
        failed |= bool(options.report) and not _report(options.report, replays, model, config)
    if failed:
        return WRONG
    if any(each.differences and any(each.differences.values()) for each in replays):
        return DIFFERENT
    return NOTHING if any(not each.learnt for each in replays) else 0


def _summary(
    path: Path, replays: list[Replay], model: LoadedModel, config: EstimatorConfig
) -> bool:
    """Write the summary of the runs; return whether that succeeded."""
    try:
        write_summary(path, summary(replays, model, config))
    except OSError as error:
        _refuse(f"{path}: the summary cannot be written: {error.strerror}")
        return False
    print(f"summary: {path}")
    return True


def _report(path: Path, replays: list[Replay], model: LoadedModel, config: EstimatorConfig) -> bool:
    """Write the page about the runs; return whether that succeeded."""
    # matplotlib takes half a second to import, and few users want a report
    from terrain_estimator.offline.run_report import write_report  # noqa: PLC0415

    try:
        write_report(path, replays, model, config)
    except OSError as error:
        _refuse(f"{path}: the report cannot be written: {error.strerror}")
        return False
    print(f"report: {path}")
    return True


def _make_room(output: Path, written: list[Path], *, overwrite: bool) -> None:
    """Remove an earlier estimates bag on request; BagError where one is in the way."""
    if output in written:
        raise BagError(
            f"{output} has the estimates of a bag of the same name: rename this one, or replay it"
            " separately with --out"
        )
    if output.exists() and not overwrite:
        raise BagError(
            f"{output} exists from an earlier replay: give --overwrite, or another folder with"
            " --out"
        )
    if overwrite and output.is_dir():
        for file in (*output.glob("*.mcap"), output / "metadata.yaml"):
            file.unlink(missing_ok=True)
        output.rmdir()


def _refuse(text: str) -> int:
    print(f"replay: {text}", file=sys.stderr)
    return WRONG


if __name__ == "__main__":
    sys.exit(main())
