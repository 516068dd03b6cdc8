# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""add_slip BAG --velocity TOPIC: copy a bag and add wheel_slip from wheel rates and a velocity.

The node slip_source does the same live. With -p empty_sinkage:=true the copy has
wheel_sinkage, too, in which nothing is measured.

Exit codes: 0 done; 2 wrong arguments, parameters or bag, or no slip could be computed.
"""

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from rover_parameters.parameters import effective
from rover_parameters.records import ConfigError
from terrain_estimator.bags import (
    BagError,
    BagReader,
    BagTopic,
    BagWriter,
    Qos,
    RawMessage,
    bag_name,
    parse_qos,
    whole_bag,
)
from terrain_estimator.config.slip_source import SlipSourceConfig
from terrain_estimator.console.arguments import command_parser
from terrain_estimator.console.interrupting import interruptible
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.files.results import new_folder
from terrain_estimator.messaging.slip_source import (
    JOINTS,
    TWICE,
    VELOCITY,
    VELOCITY_TYPES,
    SlipSource,
    SlipSourceError,
)
from terrain_estimator.offline.bag_options import add_parameters, parameters_of
from terrain_estimator.offline.topic_mapping import TopicError, absolute
from terrain_estimator.topics import INPUT_TYPES
from terramechanics.presets import load_rover

SLIP, SINKAGE = "wheel_slip", "wheel_sinkage"
WRONG = 2


class Outputs(NamedTuple):
    """Names of the topics that are added."""

    slip: str
    sinkage: str


@dataclass(slots=True)
class Added:
    """Counts of the slips that were added to a bag."""

    joints: int = 0  # messages with wheel rates
    slips: int = 0
    refused: int = 0  # pairs
    why: str = ""  # of the last refusal

    def __str__(self) -> str:
        """Describe the result in words."""
        refused = f", {self.refused} pairs refused: {self.why}" if self.refused else ""
        return f"{self.slips} slips of {self.joints} {JOINTS}{refused}"


@interruptible
def main(arguments: list[str] | None = None) -> int:
    """Write the bag that the command line asks for; return the exit code."""
    options = _parser().parse_args(arguments)
    out: Path = options.out or options.bag.resolve().with_name(f"{bag_name(options.bag)}_slip")
    names = {
        name: absolute(text, options.namespace)
        for name, text in ((JOINTS, options.joint_states), (VELOCITY, options.velocity))
    }
    try:
        with BagReader(options.bag) as reader:
            kind = _velocity_type(reader, names)
            config = parameters_of(options, "slip_source", SlipSourceConfig, velocity_type=kind)
            added = add_slip(
                reader,
                out,
                {topic: name for name, topic in names.items()},
                Outputs(absolute(SLIP, options.namespace), absolute(SINKAGE, options.namespace)),
                config,
            )
    except (BagError, ConfigError, TopicError, OSError) as error:
        print(f"add_slip: {error}", file=sys.stderr)
        return WRONG
    if names[VELOCITY] == absolute("odom", options.namespace):
        print(f"add_slip: warning: {TWICE}", file=sys.stderr)
    print(f"{out}: {added}")
    return 0


def _velocity_type(reader: BagReader, names: Mapping[str, str]) -> str:
    """Return the kind of velocity in the bag; TopicError for a missing topic or another type."""
    for name in names.values():
        if name not in reader.topics:
            raise TopicError(
                f"{reader.path} has no topic {name}; it has"
                f" {', '.join(sorted(reader.topics)) or 'none'}"
            )
    kinds = {type_name: kind for kind, type_name in VELOCITY_TYPES.items()}
    found = reader.topics[names[VELOCITY]].type_name
    if found not in kinds:
        raise TopicError(
            f"{reader.path}: topic {names[VELOCITY]} is a {found}, not a velocity: give one of"
            f" {', '.join(kinds)}"
        )
    reader.expect({names[JOINTS]: INPUT_TYPES[JOINTS]})
    return kinds[found]


def add_slip(
    reader: BagReader, out: Path, ours: Mapping[str, str], names: Outputs, config: SlipSourceConfig
) -> Added:
    """Copy a bag to ``out``, with each slip right after the message that completes its pair.

    ``ours`` maps topics of the bag to the estimator's names.

    Raises:
        TopicError: the bag has slips already, or none could be made.
        ConfigError: the rover or a parameter is wrong.
        BagError: a message cannot be read.
        OutputError: ``out`` exists already, or the disk is full; nothing is left behind.
    """
    new = [names.slip, *([names.sinkage] if config.empty_sinkage else [])]
    for topic in new:
        if topic in reader.topics:
            raise TopicError(
                f"{reader.path} has a topic {topic} already: replay it as it is, or give a bag"
                " without it"
            )
    source, added, span = SlipSource(load_rover(config.rover), config), Added(), reader.span
    with (
        new_folder(out) as place,
        whole_bag(place) as writer,
        ProgressReport(f"add_slip {out.name}") as progress,
    ):
        for name, values in reader.metadata.items():
            writer.add_metadata(name, values)
        writer.add_metadata(
            "add_slip",
            {
                **{name: topic for topic, name in ours.items()},
                "configuration": json.dumps(effective(config)),
            },
        )
        copies = _topics(reader, writer)
        topics = [
            writer.add_topic(topic, INPUT_TYPES[kind])
            for topic, kind in zip(new, (SLIP, SINKAGE), strict=False)
        ]
        for raw in reader.messages(copies):
            progress.at((raw.log_time_ns - span.first_ns) / max(1, span.duration_ns))
            writer.write(copies[raw.topic], raw.data, raw.log_time_ns, raw.publish_time_ns)
            if raw.topic in ours:
                added.joints += ours[raw.topic] == JOINTS
                _add(source, ours[raw.topic], raw, reader, writer, topics, added)
        if not added.slips:
            raise TopicError(
                f"{reader.path}: {added}: stamps of one pair may differ by pairing_tolerance,"
                f" {config.tolerance_s:g} s"
            )
    return added


def _topics(reader: BagReader, writer: BagWriter) -> dict[str, BagTopic]:
    """Add all topics of a bag to another one; TopicError for one that cannot be copied."""
    found: dict[str, BagTopic] = {}
    for name, topic in reader.topics.items():
        if topic.definition is None:
            raise TopicError(
                f"{reader.path}: topic {name} is not CDR with .msg source, and cannot be copied:"
                " record without it"
            )
        found[name] = writer.add_topic(
            name,
            topic.type_name,
            definition=topic.definition,
            qos=parse_qos(topic.qos_text) or (Qos(),),
        )
    return found


def _add(
    source: SlipSource,
    name: str,
    raw: RawMessage,
    reader: BagReader,
    writer: BagWriter,
    topics: list[BagTopic],
    added: Added,
) -> None:
    for pair in source.pair(name, reader.decode(raw)):
        try:
            message = source.slip_message(pair, writer.types.make)
        except SlipSourceError as error:
            added.refused, added.why = added.refused + 1, str(error)
            continue
        slip, *empty = topics
        writer.write_message(slip, message, raw.log_time_ns, raw.publish_time_ns)
        for topic in empty:
            nothing = source.sinkage_message(message, writer.types.make)
            writer.write_message(topic, nothing, raw.log_time_ns, raw.publish_time_ns)
        added.slips += 1


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("add_slip", __doc__)
    parser.add_argument(
        "bag",
        type=Path,
        metavar="BAG",
        help="folder of a bag or bare .mcap file; it is not changed",
    )
    parser.add_argument(
        "--velocity",
        required=True,
        metavar="TOPIC",
        help="odometry or stamped twist along body x, not that of odom",
    )
    parser.add_argument(
        "--joint-states",
        default=JOINTS,
        metavar="TOPIC",
        help="topic of the wheel rates (default: %(default)s)",
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="BAG",
        help="folder of the new bag, must not exist (default: BAG_slip)",
    )
    add_parameters(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
