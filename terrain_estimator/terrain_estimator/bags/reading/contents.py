# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What a file of a bag holds beside its messages, in the terms of MCAP."""

from collections import Counter
from dataclasses import dataclass, field

from mcap.records import Channel, Metadata, Schema

from terrain_estimator.bags.format.metadata import TimeSpan


@dataclass(slots=True)
class Contents:
    """The contents of one file, gathered when it is opened."""

    finished: bool  # whether the file was closed by its writer
    schemas: dict[int, Schema] = field(default_factory=dict)  # by their id
    channels: dict[int, Channel] = field(default_factory=dict)  # by their id
    counts: Counter[int] = field(default_factory=Counter)  # messages of each channel
    span: TimeSpan = field(default_factory=TimeSpan)  # of the log times
    metadata: list[Metadata] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # for the reader's user

    def type_name(self, channel: Channel) -> str:
        """Return the name of a channel's message type, "" where the file does not say it."""
        schema = self.schemas.get(channel.schema_id)
        return schema.name if schema else ""
