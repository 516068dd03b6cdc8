# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bags: MCAP files in the folder form of rosbag2, read and written without ROS."""

from terrain_estimator.bags.errors import BagError, BagExistsError
from terrain_estimator.bags.format.definitions import Definition, installed_definition
from terrain_estimator.bags.format.layout import Layout
from terrain_estimator.bags.format.metadata import METADATA_FILE
from terrain_estimator.bags.format.packing import Packer
from terrain_estimator.bags.format.qos import STATE, Qos, parse_qos
from terrain_estimator.bags.format.types import Message, Types
from terrain_estimator.bags.reading.compare import Difference, compare
from terrain_estimator.bags.reading.reader import (
    BagReader,
    RawMessage,
    TopicInfo,
    bag_name,
    in_order,
)
from terrain_estimator.bags.reading.sequence_number import is_sequenced, sequence_of
from terrain_estimator.bags.reading.storage import ENDINGS
from terrain_estimator.bags.recovery.recovery import Recovery, recover
from terrain_estimator.bags.writing.part import BagTopic
from terrain_estimator.bags.writing.writer import BagWriter, Split, whole_bag

__all__ = [
    "ENDINGS",
    "METADATA_FILE",
    "STATE",
    "BagError",
    "BagExistsError",
    "BagReader",
    "BagTopic",
    "BagWriter",
    "Definition",
    "Difference",
    "Layout",
    "Message",
    "Packer",
    "Qos",
    "RawMessage",
    "Recovery",
    "Split",
    "TopicInfo",
    "Types",
    "bag_name",
    "compare",
    "in_order",
    "installed_definition",
    "is_sequenced",
    "parse_qos",
    "recover",
    "sequence_of",
    "whole_bag",
]
