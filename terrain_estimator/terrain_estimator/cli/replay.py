# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""replay BAG...: estimate from recordings without ROS, by the same code as the live node.

Exit codes: 0 done; 1 the comparison with the live estimates found a difference; 2 wrong arguments,
parameters, model or bag; 3 a bag gave no estimate: nothing was used, or the model does not fit.
"""

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rover_parameters.parameters import template
from rover_parameters.records import ConfigError
from terrain_estimator.bags import BagError
from terrain_estimator.compiled.finding import Chosen, load
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.console.arguments import command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.estimator.saved_state import StateFileError
from terrain_estimator.estimator.summary import Beliefs
from terrain_estimator.files.atomic import OutputError, write_file
from terrain_estimator.files.results import ResultFolder, check_new, write_new
from terrain_estimator.messaging.pipeline import rover_of
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import ModelFileError
from terrain_estimator.offline.bag_options import add_options, node_config
from terrain_estimator.offline.reference_drives import judge_sensors
from terrain_estimator.offline.replay import Start, compare_with_live, replay
from terrain_estimator.offline.replay_result import Replay
from terrain_estimator.offline.run_names import run_names
from terrain_estimator.offline.summary import print_table, summary, write_summary
from terrain_estimator.offline.topic_mapping import TopicError, absolute, bag_topics

DIFFERENT, WRONG, NOTHING = 1, 2, 3
SUMMARY = "summary.json"


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Replay the bags that the command line names; return the exit code."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if not (options.bags or options.dump_config):
        parser.error("no bag is named: give the folder of a recording")
    try:
        parameters = node_config(options, **({"model": options.model} if options.model else {}))
        config = parameters.estimator
        if options.dump_config:
            print(template(absolute("estimator", options.namespace), parameters))
            return 0
        chosen = load(config.model, config.runtime)
        model = chosen.model
        names = bag_topics(options.remap, options.namespace)
        rover_of(model.metadata, config.rover)
        Beliefs.of(model.metadata, config.core)
        _, doubt = judge_sensors(model, config)
        if doubt:
            print(f"replay: {doubt}", file=sys.stderr)
        start = Start.read(options.state, model.sha256) if options.state else None
        output = _ReplayFiles(options)
    except (ModelFileError, ConfigError, TopicError, StateFileError, OSError) as error:
        return _refuse(str(error))
    return _replay_all(options, chosen, config, names, start, output)


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
        help="folder for estimates bags and summary.json, new or of earlier replays (default:"
        " %(default)s)",
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
        help="write a page about the runs: one HTML file, new or in the folder of --out",
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
        "--overwrite",
        action="store_true",
        help="replace estimates bags that an earlier replay wrote to --out",
    )
    return parser


class _ReplayFiles:
    """The places of all results, checked before any work; raises ConfigError or OutputError."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.results, self.runs = ResultFolder(options.out), run_names(options.bags)
        self.report: Path | None = options.report
        self._overwrite: bool = options.overwrite
        if self.report and self.report.suffix != ".html":
            raise ConfigError(f"--report {self.report}: the name must end with .html")
        self.inside = bool(self.report) and self.report.parent.resolve() == options.out.resolve()
        self.results.check(*self.told)
        if self.report and not self.inside:
            check_new(self.report)

    @property
    def told(self) -> tuple[str, ...]:
        """Names of the files about all runs in the folder of results."""
        return (SUMMARY, self.report.name) if self.report and self.inside else (SUMMARY,)

    @contextmanager
    def renewing(self, run: str) -> Iterator[Path]:
        """Yield the place of an estimates bag; OutputError where one is there already."""
        name = f"{run}_estimates"
        if not self._overwrite and os.path.lexists(self.results.path / name):
            raise OutputError(
                f"{self.results.path / name} exists from an earlier replay: give --overwrite, or"
                " another folder with --out"
            )
        with self.results.renewing(name) as new:
            yield new / name


def _replay_all(
    options: argparse.Namespace,
    chosen: Chosen,
    config: EstimatorConfig,
    names: dict[str, str],
    start: Start | None,
    output: _ReplayFiles,
) -> int:
    """Replay one bag after the other, each from the same start.

    A bag that fails does not stop the others, and leaves earlier estimates as they are.
    """
    replays: list[Replay] = []
    failed = False
    for bag, name in zip(options.bags, output.runs, strict=True):
        try:
            with output.renewing(name) as place:
                replays.append(replay(bag, place, chosen, config, names, start))
            replays[-1].name, replays[-1].estimates_bag = name, output.results.path / place.name
            if options.compare:
                compare_with_live(replays[-1], names)
        except (BagError, TopicError, StateFileError, OSError) as error:
            failed = True
            _refuse(str(error))
    if replays:
        print_table(replays)
        failed |= not _tell(output, replays, chosen.model, config)
    if failed:
        return WRONG
    if any(each.differences and any(each.differences.values()) for each in replays):
        return DIFFERENT
    return 0 if all(each.gave_estimate for each in replays) else NOTHING


def _tell(
    output: _ReplayFiles, replays: list[Replay], model: LoadedModel, config: EstimatorConfig
) -> bool:
    """Write summary and report; return whether that succeeded."""
    try:
        page = _page(replays, model, config) if output.report else ""
        with output.results.renewing(*output.told) as new:
            write_summary(new / SUMMARY, summary(replays, model, config))
            if output.report and output.inside:
                write_file(new / output.report.name, page)
        print(f"summary: {output.results.path / SUMMARY}")
        if output.report and not output.inside:
            write_new(output.report, page)
    except OSError as error:
        _refuse(str(error))
        return False
    if output.report:
        print(f"report: {output.report}")
    return True


def _page(replays: list[Replay], model: LoadedModel, config: EstimatorConfig) -> str:
    # matplotlib takes half a second to import, and few users want a report
    from terrain_estimator.offline.run_report import report_page  # noqa: PLC0415

    return report_page(replays, model, config)


def _refuse(text: str) -> int:
    print(f"replay: {text}", file=sys.stderr)
    return WRONG


if __name__ == "__main__":
    sys.exit(main())
