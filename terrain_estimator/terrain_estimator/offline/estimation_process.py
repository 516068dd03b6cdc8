# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Estimate in a second process while this one reads, converts and writes, given two cores.

The processes take turns: this one prepares a batch while the other estimates from the batch
before. Only one batch is under way, so neither can block the other, and each ends when the other
closes its end of the pipe.
"""

import itertools
import multiprocessing
import os
import signal
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.reduction import ForkingPickler
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.bags import RawMessage
from terrain_estimator.messaging.columns import ObservationRow, Observations
from terrain_estimator.messaging.conversion import Conversion, Mark
from terrain_estimator.messaging.pipeline import Answer, Pipeline
from terrain_estimator.observation import AXLE_FIELDS, SCALAR_FIELDS, Floats, Observation
from terrain_estimator.update import Update

Converted: TypeAlias = list[tuple[RawMessage, Conversion | ObservationRow]]
"""A batch of sets, each with the message that completed it."""

Answered: TypeAlias = list[tuple[RawMessage, Answer]]
"""A batch of answers, each with the message that completed its set."""

Answering: TypeAlias = Callable[[Iterable[Converted]], Iterator[Answered]]
"""A function that answers batches in their order."""

_Packed: TypeAlias = tuple[NDArray[np.int64], Floats, Floats, dict[int, Conversion]]
"""A batch of n sets in few arrays.

Stamps, marks and whether sinkages are local [n, 3], values of axles [n, fields, axles] and scalars
[n, fields]; sets without an observation by position.
"""


@contextmanager
def answering(pipeline: Pipeline) -> Iterator[Answering]:
    """Answer by ``pipeline`` in a second process, or in this one where that does not pay.

    It does not on a single core, nor in a worker, which has the other cores' workers beside it: a
    daemonic process may have no child, and a fork from a thread could inherit held locks.

    Enter the context before any thread is started: the second process is a fork of this one, which
    has the model loaded and warm.
    """
    if len(os.sched_getaffinity(0)) < 2 or _is_worker():
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


def _is_worker() -> bool:
    return (
        multiprocessing.current_process().daemon
        or threading.current_thread() is not threading.main_thread()
    )


def _in_turn(pipeline: Pipeline, batches: Iterable[Converted]) -> Iterator[Answered]:
    for batch in batches:
        yield [
            (
                cause,
                pipeline.answer(taken.conversion() if isinstance(taken, ObservationRow) else taken),
            )
            for cause, taken in batch
        ]


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


def _pack(batch: list[Conversion | ObservationRow]) -> _Packed:
    """Pack a batch into few large arrays.

    An object for each observation would cost as much as the estimate's arithmetic.
    """
    without = {
        at: each
        for at, each in enumerate(batch)
        if isinstance(each, Conversion) and each.observation is None
    }
    taken = [each for at, each in enumerate(batch) if at not in without]
    stamps = np.array(
        [(each.stamp_ns, each.mark, _is_local(each)) for each in taken],
        dtype=np.int64,
    ).reshape(-1, 3)
    parts = [
        _packed_rows(key, list(part))
        for key, part in itertools.groupby(
            taken, lambda each: each.observations if isinstance(each, ObservationRow) else None
        )
    ]
    if not parts:
        return stamps, np.empty(0), np.empty(0), without
    axles, scalars = (np.concatenate(values) for values in zip(*parts, strict=True))
    return stamps, axles, scalars, without


def _is_local(taken: Conversion | ObservationRow) -> bool:
    if isinstance(taken, ObservationRow):
        return taken.observations.local
    return taken.observation is not None and taken.observation.local


def _packed_rows(of: Observations | None, part: list[Any]) -> tuple[Floats, Floats]:
    """Return values of axles and scalars of rows ``of`` many, or of single conversions."""
    if of is not None:
        rows = [each.at for each in part]
        return of.axles[rows], of.scalars[rows]
    observations = [each.observation for each in part]
    steered = any(each.steering is not None for each in observations)
    axles, scalars = (
        np.array(
            [[getattr(observation, name) for name in names] for observation in observations],
            dtype=np.float64,
        )
        for names in ((*AXLE_FIELDS, *_STEERING[:steered]), SCALAR_FIELDS)
    )
    return axles, scalars


_MARKS = tuple(Mark)
_STEERING = ("steering",)  # the last of the arrays, where wheels are steered


def _unpack(packed: _Packed) -> Iterator[Conversion]:
    stamps, axles, scalars, without = packed
    arrays = len(AXLE_FIELDS)
    steered = axles.ndim > 1 and axles.shape[1] > arrays
    angles = iter(axles[:, arrays]) if steered else itertools.repeat(None)
    observations = zip(
        stamps.tolist(), axles[:, :arrays] if steered else axles, scalars.tolist(), strict=True
    )
    for at in range(len(stamps) + len(without)):
        if at in without:
            yield without[at]
        else:
            (stamp_ns, mark, local), by_axle, single = next(observations)
            # in the order of the fields
            numbers = (*by_axle, *single, next(angles), bool(local))
            yield Conversion(stamp_ns, Observation(stamp_ns, *numbers), mark=_MARKS[mark])
