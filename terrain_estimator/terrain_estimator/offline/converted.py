# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""From the messages of a bag to what the estimator takes: read, paired, converted, averaged.

Each step takes a batch of messages, as columns where their layout allows it. The answers are those
of one message at a time: every step keeps the order, and no step depends on a later one.
"""

import itertools
from collections.abc import Container, Iterator, Mapping

from terrain_estimator.bags import BagReader, RawMessage, is_sequenced, sequence_of
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.messaging.columns import ObservationRow, Observations, Row
from terrain_estimator.messaging.conversion import Conversion
from terrain_estimator.messaging.pairing import MessageSet
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.messaging.sequence_numbers import Sequences
from terrain_estimator.offline.column_reader import ColumnReader, alike, decoded
from terrain_estimator.offline.estimation_process import Converted
from terrain_estimator.offline.replay_result import Replay

TRUTH = "ground_truth/terrain"
BATCH = 2000  # messages


def converted(
    reader: BagReader,
    pipeline: Pipeline,
    names: Mapping[str, str],
    result: Replay,
    progress: ProgressReport,
) -> Iterator[Converted]:
    """Yield the sets of the bag in batches, each with the message that completed it.

    Sets that still wait at the end of the bag come last.
    """
    ours = {names[name]: name for name in (*pipeline.inputs, TRUTH)}
    span = reader.span
    cause: RawMessage | None = None

    columns = ColumnReader(reader, pipeline, names)
    taking = _Taking(pipeline, result)
    messages = _counted(reader, ours, {names[name] for name in pipeline.inputs}, result.sequences)
    while batch := list(itertools.islice(messages, BATCH)):
        progress.at((batch[0].log_time_ns - span.first_ns) / max(1, span.duration_ns))
        read = list(zip(batch, columns.read(batch), strict=True))
        result.truths += [message for raw, message in read if ours[raw.topic] == TRUTH]
        inputs = [each for each in read if ours[each[0].topic] != TRUTH]
        sets = [
            (raw, complete)
            for raw, message in inputs
            for complete in (
                pipeline.pair_row(message)
                if isinstance(message, Row)
                else pipeline.pair(ours[raw.topic], message)
            )
        ]
        yield taking.of(sets)
        cause = inputs[-1][0] if inputs else cause
    if cause is not None:
        last = taking.of([(cause, complete) for complete in pipeline.rest()])
        yield [*last, *((cause, taken) for taken in pipeline.rest_of_means())]


class _Taking:
    """Conversion of sets to what the estimator takes, with their histories and rates."""

    def __init__(self, pipeline: Pipeline, result: Replay) -> None:
        self._pipeline, self._result = pipeline, result

    def of(self, sets: list[tuple[RawMessage, MessageSet]]) -> Converted:
        """Return what the estimator takes of these sets, in their order."""
        taken: Converted = []
        for run, many in alike(self._pipeline, sets):
            if many is None:
                taken += [each for cause, complete in run for each in self._single(cause, complete)]
            else:
                self._result.keep_rows([complete for _, complete in run])
                taken += self._of_rows(run, many)
        return taken

    def _single(self, cause: RawMessage, complete: MessageSet) -> Converted:
        complete = decoded(complete)
        self._result.keep_wheels(complete)
        return self._averaged(cause, self._pipeline.convert(complete))

    def _averaged(self, cause: RawMessage, conversion: Conversion) -> Converted:
        taken = self._pipeline.average(conversion)
        self._result.rates.add(self._pipeline.rate)
        return [(cause, each) for each in taken]

    def _of_rows(
        self, run: list[tuple[RawMessage, MessageSet]], many: Observations
    ) -> Iterator[tuple[RawMessage, Conversion | ObservationRow]]:
        pipeline, rates = self._pipeline, self._result.rates
        for at, (cause, complete) in enumerate(run):
            if not many.ordinary[at]:
                yield from self._averaged(cause, pipeline.convert(decoded(complete)))
                continue
            row = ObservationRow(many, at)
            if pipeline.passes(complete.stamp_ns):
                yield cause, row
            else:
                yield from ((cause, each) for each in pipeline.take(row.conversion()))
            rates.add(pipeline.rate)


def _counted(
    reader: BagReader, wanted: Container[str], paired: Container[str], sequences: Sequences
) -> Iterator[RawMessage]:
    """Yield the wanted messages, and count gaps in all msg_defs messages.

    Pairing counts the gaps of the inputs.
    """
    counted = {
        name
        for name, topic in reader.topics.items()
        if name not in paired and is_sequenced(topic.definition)
    }
    for raw in reader.messages(
        [name for name in reader.topics if name in wanted or name in counted]
    ):
        if raw.topic in counted and (sequence := sequence_of(raw.data)) is not None:
            sequences.note(raw.topic, sequence)
        if raw.topic in wanted:
            yield raw
