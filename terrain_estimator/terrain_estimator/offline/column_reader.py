# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of a bag as columns where their layout allows it, otherwise one by one."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import groupby

from terrain_estimator.bags import BagReader, Layout, Message, RawMessage
from terrain_estimator.messaging.columns import (
    Observations,
    Row,
    columns_of,
)
from terrain_estimator.messaging.pairing import MessageSet
from terrain_estimator.messaging.pipeline import Pipeline

FEWEST = 8
"""Messages or sets in a batch that are worth arrays."""
LAYOUTS = 64
"""Layouts that are kept; a bag whose messages have more lengths is read one by one."""


class ColumnReader:
    """Read the inputs of a pipeline from batches of raw messages."""

    def __init__(self, reader: BagReader, pipeline: Pipeline, names: Mapping[str, str]) -> None:
        """Take the topics in the bag by the pipeline's names."""
        self._reader, self._pipeline = reader, pipeline
        self._inputs = {names[name]: name for name in pipeline.inputs}
        # by topic and length, with the size in memory; None where that is not worth arrays
        self._layouts: dict[tuple[str, int], tuple[Layout, int] | None] = {}

    def read(self, batch: Sequence[RawMessage]) -> list[Message | Row]:
        """Return each message decoded, or as a row of columns. Raises BagError."""
        rows: dict[int, Row] = {}
        alike: defaultdict[tuple[str, int], list[int]] = defaultdict(list)
        for at, raw in enumerate(batch):
            if raw.topic in self._inputs:
                alike[raw.topic, len(raw.data)].append(at)
        for key, places in alike.items():
            if len(places) >= FEWEST:
                rows |= self._rows(key, places, [batch[at] for at in places])
        return [rows.get(at) or self._reader.decode(raw) for at, raw in enumerate(batch)]

    def _rows(
        self, key: tuple[str, int], places: list[int], messages: list[RawMessage]
    ) -> dict[int, Row]:
        """Return the messages that fit the layout as rows, by their places."""
        topic = self._inputs[key[0]]
        if key not in self._layouts:
            self._learn(key, messages[0])
        known = self._layouts.get(key)
        if known is None:
            return {}
        layout, size = known
        values, fits = layout.rows([message.data for message in messages])
        fitting = fits.nonzero()[0].tolist()
        if 2 * len(fitting) < len(messages):  # the texts have changed: the next batch may fit
            self._learn(key, messages[-1])
        if len(fitting) < FEWEST:
            return {}
        chosen = [messages[at] for at in fitting]
        read = partial(self._decoded, chosen)
        columns = columns_of(topic, layout.example, size, values[fitting], read)
        return {places[at]: Row(columns, number) for number, at in enumerate(fitting)}

    def _decoded(self, messages: list[RawMessage], at: int) -> Message:
        return self._reader.decode(messages[at])

    def _learn(self, key: tuple[str, int], message: RawMessage) -> None:
        if len(self._layouts) >= LAYOUTS and key not in self._layouts:
            return
        layout = self._reader.layout(message)
        size = layout and self._pipeline.column_size(
            self._inputs[key[0]], layout.example, layout.dtype
        )
        self._layouts[key] = (layout, size) if layout and size else None


def alike(
    pipeline: Pipeline, sets: Sequence[tuple[RawMessage, MessageSet]]
) -> Iterator[tuple[list[tuple[RawMessage, MessageSet]], Observations | None]]:
    """Yield runs of sets of the same columns with their observations; None for single sets."""
    for key, group in groupby(sets, lambda pair: _columns_of(pair[1])):
        run = list(group)
        many = None
        if key is not None and len(run) >= FEWEST:
            stamps = [complete.stamp_ns for _, complete in run]
            many = pipeline.observe(stamps, [complete.messages for _, complete in run])
        yield run, many


def _columns_of(complete: MessageSet) -> tuple[int, ...] | None:
    """Return which columns a set is of; None where a message is of none."""
    which = []
    for message in complete.messages:
        if message is not None and not isinstance(message, Row):
            return None
        which.append(0 if message is None else id(message.columns))
    return tuple(which)


def decoded(complete: MessageSet) -> MessageSet:
    """Return a set with its messages decoded."""
    messages = (each.message() if isinstance(each, Row) else each for each in complete.messages)
    return MessageSet(complete.stamp_ns, tuple(messages))
