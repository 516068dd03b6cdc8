# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""fleet replay SOURCE...: replay all bags in folders and object stores on a cluster.

fleet discover SOURCE...: find_missing_effect on all bags of the sources, each content once; its
options and exit codes: fleet discover --help.

A SOURCE is a folder, searched with all folders below it, a bag, or an address such as
s3://bucket/folder. Writes OUT/bags.parquet, one row a bag, and OUT/seconds.parquet, one row a
second of estimate. The same command goes on where an earlier one was ended, even by kill -9.

Exit codes: 0 every bag gave an estimate; 2 wrong arguments, parameters or model, the cluster was
lost, or a bag could not be read or replayed: the others are done all the same; 3 a bag gave no
estimate: nothing was used, or the model does not fit; 130 interrupted.
"""

import dataclasses
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rover_parameters.parameters import effective
from rover_parameters.records import ConfigError
from terrain_estimator.compiled.finding import load
from terrain_estimator.config.estimator import EstimatorConfig
from terrain_estimator.console.arguments import WORKERS, add_out, command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.printing import print_lines
from terrain_estimator.estimator.summary import Beliefs
from terrain_estimator.files.results import ResultFolder
from terrain_estimator.fleet.bringing import bring, is_remote
from terrain_estimator.fleet.journal import Journal
from terrain_estimator.fleet.sources import FleetError, find_bags, full_name
from terrain_estimator.fleet.tables import BAGS, SECONDS, FleetTables
from terrain_estimator.fleet.task import (
    DAMAGED,
    EQUAL,
    ESTIMATE,
    FAILED,
    NO_ESTIMATE,
    OTHER_TOPICS,
    Settings,
    content_of,
    replayed,
)
from terrain_estimator.fleet.work import Dispatch, work
from terrain_estimator.messaging.pipeline import configuration_sha256, rover_of
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import ModelFileError
from terrain_estimator.offline.bag_options import add_options, node_config
from terrain_estimator.offline.cluster import ClusterError, cluster
from terrain_estimator.offline.reference_drives import judge_sensors
from terrain_estimator.offline.summary import write_summary
from terrain_estimator.offline.topic_mapping import TopicError, bag_topics

DISCOVER = "discover"
WRONG, NOTHING = 2, 3
FLEET, JOURNAL = "fleet.json", "journal.sqlite"


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Run the command; return the exit code."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments[:1] == [DISCOVER]:
        return _discover(arguments[1:])
    return _replay(_parser().parse_args(arguments))


def _replay(options: Namespace) -> int:
    """Replay all bags of the sources; return the exit code."""
    try:
        sources = [full_name(source) for source in options.sources]
        given = {"model": options.model} if options.model else {}
        config = _anywhere(node_config(options, **given).estimator)
        model = load(config.model, config.runtime).model
        names = bag_topics(options.remap, options.namespace)
        rover_of(model.metadata, config.rover)
        Beliefs.of(model.metadata, config.core)
        _, doubt = judge_sensors(model, config)
        if doubt:
            _say(doubt)
        settings = Settings(config, names, model.sha256)
        identity = _identity(sources, settings, model)
        return _replay_all(options, sources, settings, identity)
    except (ClusterError, ConfigError, FleetError, ModelFileError, TopicError, OSError) as error:
        sys.stderr.write(f"fleet: {error}\n")
        return WRONG


def _parser() -> ArgumentParser:
    parser = command_parser("fleet", __doc__)
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    actions.add_parser(DISCOVER, help="search all bags of folders for a missing effect")
    action = actions.add_parser("replay", help="replay all bags of the sources")
    action.add_argument(
        "sources", nargs="+", metavar="SOURCE", help="folder, bag, or address such as s3://bucket"
    )
    add_out(action, "out/fleet", "folder of the results, new or of the same fleet")
    action.add_argument(
        "--scheduler",
        default="",
        metavar="ADDRESS",
        help="dask.distributed scheduler (default: processes of this machine)",
    )
    action.add_argument(
        "--workers",
        type=WORKERS,
        default=0,
        help="processes of this machine (default: one for each CPU)",
    )
    action.add_argument(
        "--model",
        default="",
        help="name of an installed model or path of a model file (default: mars_rover)",
    )
    add_options(action)
    return parser


def _anywhere(config: EstimatorConfig) -> EstimatorConfig:
    """Return the configuration with absolute paths: workers may have another working folder."""
    model, rover = (
        str(path.absolute()) if (path := Path(name)).suffix and path.is_file() else name
        for name in (config.model, config.rover)
    )
    return dataclasses.replace(config, model=model, rover=rover)


def _identity(sources: list[str], settings: Settings, model: LoadedModel) -> dict[str, Any]:
    """Return everything that the tables depend on, by name."""
    config = effective(settings.config)
    del config["model"], config["rover"]  # files may move; their contents are in the hashes
    return {
        "sources": sources,
        "model_sha256": settings.model_sha256,
        "configuration_sha256": configuration_sha256(model, settings.config),
        **config,
        **{f"topic {name}": topic for name, topic in settings.names.items()},
    }


def _replay_all(
    options: Namespace, sources: list[str], settings: Settings, identity: dict[str, Any]
) -> int:
    results = ResultFolder(options.out)
    if not (options.out / JOURNAL).exists():
        with results.renewing(FLEET) as new:
            write_summary(new / FLEET, identity)
    with (
        Journal(options.out / JOURNAL, identity) as journal,
        cluster(options.scheduler, options.workers or None) as on,
    ):
        tables = FleetTables(results, journal)
        dispatch = Dispatch(on, journal, content_of, partial(replayed, settings=settings))
        listed = work(dispatch, journal, tables, sources)
        tables.complete()
        counts = journal.counts
    words = ", ".join(
        f"{counts[outcome]} {told}" for outcome, told in _TOLD.items() if counts[outcome]
    )
    print_lines(
        [
            f"{counts.total()} bags: {words or 'none was found'}",
            *(str(options.out / table) for table in (BAGS, SECONDS)),
        ]
    )
    if not listed or not counts.total() or any(counts[outcome] for outcome in _UNREAD):
        return WRONG
    return NOTHING if counts[NO_ESTIMATE] else 0


def _discover(arguments: list[str]) -> int:
    """Search the bags of folders for a missing effect; return the exit code."""
    # scipy and the search take a second to import, and a replay does not need them
    from terrain_estimator.cli.find_missing_effect import search, search_parser  # noqa: PLC0415

    parser = search_parser(f"fleet {DISCOVER}")
    _add_bring(parser)
    known: dict[str, str] = {}
    try:
        options = parser.parse_args(_with_copies(arguments))
        options.runs = _distinct(options.runs, known)
        options.hold_out = _distinct(options.hold_out, known)
    except FleetError as error:
        sys.stderr.write(f"fleet: {error}\n")
        return WRONG
    return search(options)


def _add_bring(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--bring",
        type=Path,
        default=Path("out/brought"),
        metavar="FOLDER",
        help="folder in which copies of the bags at addresses such as s3://bucket are kept, of this"
        " machine and of all workers (default: %(default)s)",
    )


def _with_copies(arguments: Sequence[str]) -> list[str]:
    """Return the arguments with folders of copies in place of addresses of object stores.

    A search reads every bag several times, so that copies stay. Raises FleetError.
    """
    parser = ArgumentParser(add_help=False, allow_abbrev=False)
    _add_bring(parser)
    folder = parser.parse_known_args(arguments)[0].bring
    return [
        str(bring(each, folder, _say))
        if before != "--scheduler" and not each.startswith("--") and is_remote(each)
        else each
        for before, each in zip(["", *arguments], arguments, strict=False)
    ]


def _say(line: str) -> None:
    sys.stderr.write(f"fleet: {line}\n")


def _distinct(folders: Sequence[Path], known: dict[str, str]) -> list[Path]:
    """Return the bags in folders by name, without those whose content is ``known`` already.

    Raises FleetError where a folder is not there.
    """
    found = {bag.name: bag for folder in folders for bag in find_bags(str(folder), _say)}
    bags = []
    for name, bag in sorted(found.items()):
        content = content_of(bag)
        other = known.setdefault(content, name) if isinstance(content, str) else name
        if other == name:
            bags.append(Path(name))
        else:
            _say(f"{name} has the content of {other}: it is counted once")
    return bags


_UNREAD = (DAMAGED, OTHER_TOPICS, FAILED)
_TOLD = {
    ESTIMATE: "with an estimate",
    NO_ESTIMATE: "without",
    EQUAL: "equal to another",
    DAMAGED: "damaged",
    OTHER_TOPICS: "with other topics",
    FAILED: "failed",
}

if __name__ == "__main__":
    sys.exit(main())
