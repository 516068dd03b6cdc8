# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Estimate in a second process while this one reads, converts and writes, given two cores.

The processes take turns: this one prepares a batch while the other estimates from the batch
before. Only one batch is under way, so neither can block the other, and each ends when the other
closes its end of the pipe.
"""

import dataclasses
import multiprocessing
import operator
import os
import signal
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.bags import RawMessage
from terrain_estimator.messaging.conversion import Conversion, Mark
from terrain_estimator.messaging.pipeline import Answer, Pipeline
from terrain_estimator.observation import AXLE_FIELDS, SCALAR_FIELDS, Floats, Observation
from terrain_estimator.update import Decision, Disagreement, Estimate, Prediction, Update

Converted: TypeAlias = list[tuple[RawMessage, Conversion]]
"""A batch of sets, each with the message that completed it."""

Answered: TypeAlias = list[tuple[RawMessage, Answer]]
"""A batch of answers, each with the message that completed its set."""

Answering: TypeAlias = Callable[[Iterable[Converted]], Iterator[Answered]]
"""A function that answers batches in their order."""

_Packed: TypeAlias = tuple[NDArray[np.int64], Floats, Floats, dict[int, Conversion]]
"""A batch of n sets in few arrays.

Stamps and marks [n, 2], values of axles [n, fields, axles] and scalars [n, fields]; sets without an
observation by position.
"""


@contextmanager
def answering(pipeline: Pipeline) -> Iterator[Answering]:
    """Answer by ``pipeline`` in a second process, or in this one where there is only one core.

    Enter the context before any thread is started: the second process is a fork of this one, which
    has the model loaded and warm.
    """
    if len(os.sched_getaffinity(0)) < 2:
        yield partial(_in_turn, pipeline)
        return
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe()
    process = context.Process(
        target=_serve, args=(there, here, pipeline), name="estimation", daemon=True
    )
    process.start()
    there.close()
    try:
        yield partial(_alongside, here)
    finally:
        here.close()  # ends the process
        process.join()


def _by_call(
    record: Update | Estimate | Prediction | Decision | Disagreement,
) -> tuple[type, tuple[object, ...]]:
    """Return the call that rebuilds a record.

    The standard library's way for a dataclass with slots takes three times as long.
    """
    kind = type(record)
    return kind, _VALUES[kind](record)


_VALUES = {
    kind: operator.attrgetter(*(field.name for field in dataclasses.fields(kind)))
    for kind in (Update, Estimate, Prediction, Decision, Disagreement)
}
for _kind in _VALUES:
    ForkingPickler.register(_kind, _by_call)


def _in_turn(pipeline: Pipeline, batches: Iterable[Converted]) -> Iterator[Answered]:
    for batch in batches:
        yield [(cause, pipeline.answer(conversion)) for cause, conversion in batch]


def _alongside(pipe: Connection, batches: Iterable[Converted]) -> Iterator[Answered]:
    """Receive the answers of a batch before the next one is sent, and decode them after.

    The second process thus never waits for the decoding.
    """
    under_way: Converted | None = None
    for batch in batches:
        packed = ForkingPickler.dumps(_pack([conversion for _, conversion in batch]))
        received = b"" if under_way is None else _receive(pipe)
        _send(pipe, packed)
        if under_way is not None:
            yield _decode(under_way, received)
        under_way = batch
    if under_way is not None:
        yield _decode(under_way, _receive(pipe))


def _decode(batch: Converted, received: bytes) -> Answered:
    """Return the answers; raise what the estimator raised in the other process."""
    updates: list[Update] | Exception = ForkingPickler.loads(received)
    if isinstance(updates, Exception):
        raise updates
    return [
        (cause, Answer(update, conversion.notes))
        for (cause, conversion), update in zip(batch, updates, strict=True)
    ]


def _send(pipe: Connection, packed: memoryview) -> None:
    try:
        pipe.send_bytes(packed)
    except OSError as error:
        raise ChildProcessError(_ENDED) from error


def _receive(pipe: Connection) -> bytes:
    try:
        return pipe.recv_bytes()
    except (EOFError, OSError) as error:
        raise ChildProcessError(_ENDED) from error


_ENDED = (
    "the estimating process ended unexpectedly: it was killed, or memory ran out. Replay the bag"
    " again"
)


def _serve(pipe: Connection, other_end: Connection, pipeline: Pipeline) -> None:
    """Answer batches until the pipe is closed: the main function of the second process."""
    other_end.close()  # this process's copy: its end would go unnoticed while this is open
    # Ctrl-C reaches both processes; the first one ends this one
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # a command's own handler is useless here
    try:
        while True:
            pipe.send(_updates(pipeline, pipe.recv()))
    except (EOFError, OSError):
        pipe.close()


def _updates(pipeline: Pipeline, packed: _Packed) -> list[Update] | Exception:
    try:
        return [pipeline.answer(conversion).update for conversion in _unpack(packed)]
    except Exception as error:  # noqa: BLE001 - raised again in the first process
        error.add_note(f"in the estimating process:\n{traceback.format_exc()}")
        return error


def _pack(conversions: list[Conversion]) -> _Packed:
    """Pack a batch into few large arrays.

    An object for each observation would cost as much as the estimate's arithmetic.
    """
    without = {
        at: conversion
        for at, conversion in enumerate(conversions)
        if conversion.observation is None
    }
    observations = [
        conversion.observation for conversion in conversions if conversion.observation is not None
    ]
    stamps = np.array(
        [
            (conversion.stamp_ns, conversion.mark)
            for conversion in conversions
            if conversion.observation is not None
        ],
        dtype=np.int64,
    ).reshape(-1, 2)
    axles = np.array(
        [[getattr(observation, name) for name in AXLE_FIELDS] for observation in observations],
        dtype=np.float64,
    )
    scalars = np.array(
        [[getattr(observation, name) for name in SCALAR_FIELDS] for observation in observations],
        dtype=np.float64,
    )
    return stamps, axles, scalars, without


def _unpack(packed: _Packed) -> Iterator[Conversion]:
    stamps, axles, scalars, without = packed
    observations = zip(stamps.tolist(), axles, scalars.tolist(), strict=True)
    for at in range(len(stamps) + len(without)):
        if at in without:
            yield without[at]
        else:
            (stamp_ns, mark), by_axle, single = next(observations)
            yield Conversion(stamp_ns, Observation(stamp_ns, *by_axle, *single), mark=Mark(mark))
