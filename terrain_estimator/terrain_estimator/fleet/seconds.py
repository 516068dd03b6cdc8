# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Seconds of estimate: the last estimate of each second of stamps, as an Arrow table."""

from collections.abc import Iterator
from contextlib import contextmanager

import pyarrow as pa

from terrain_estimator.messaging.messages import status_of
from terrain_estimator.messaging.pipeline import Pipeline
from terrain_estimator.offline.estimation_process import Answered
from terrain_estimator.offline.replay import Keep
from terrain_estimator.update import Update

COLUMNS = pa.schema(
    [
        ("stamp_ns", pa.int64()),
        ("cohesion_pa", pa.float64()),
        ("tan_phi", pa.float64()),
        ("cohesion_variance_pa2", pa.float64()),
        ("covariance_pa", pa.float64()),
        ("tan_phi_variance", pa.float64()),
        ("status", pa.string()),
    ]
)
SECOND_NS = 1_000_000_000


class Seconds:
    """The seconds of one run; open by :meth:`into`."""

    def __init__(self) -> None:
        """Start without any."""
        self._rows: list[tuple[object, ...]] = []
        self._second: int | None = None
        self._last: tuple[object, ...] = ()

    @contextmanager
    def into(self, pipeline: Pipeline, _: dict[str, str]) -> Iterator[Keep]:
        """Keep the seconds of a pipeline's answers."""
        usable = pipeline.meta.rows

        def keep(answers: Answered) -> None:
            for _, answer in answers:
                self._add(answer.update, status_of(answer.update, usable).name)

        yield keep
        self._close()

    def packed(self) -> bytes:
        """Return the table in Arrow's stream format, compressed."""
        columns = zip(*self._rows, strict=True) if self._rows else [()] * len(COLUMNS)
        table = pa.table([list(column) for column in columns], schema=COLUMNS)
        sink = pa.BufferOutputStream()
        options = pa.ipc.IpcWriteOptions(compression="zstd")
        with pa.ipc.new_stream(sink, COLUMNS, options=options) as writer:
            writer.write_table(table)
        return bytes(sink.getvalue())

    def _add(self, update: Update, status: str) -> None:
        second = update.stamp_ns // SECOND_NS
        if second != self._second:
            self._close()
            self._second = second
        mean, covariance = update.estimate.mean, update.estimate.covariance
        self._last = (
            update.stamp_ns,
            float(mean[0]),
            float(mean[1]),
            float(covariance[0, 0]),
            float(covariance[0, 1]),
            float(covariance[1, 1]),
            status,
        )

    def _close(self) -> None:
        if self._last:
            self._rows.append(self._last)
            self._last = ()


def unpacked(packed: bytes) -> pa.Table:
    """Return the table of :meth:`Seconds.packed`."""
    with pa.ipc.open_stream(packed) as reader:
        return reader.read_all()
