# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Records of the pieces of a long measurement, so that it can end and continue at any time."""

import itertools
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from studies.workers import workers
from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.files.atomic import replacing, write_file

_Result = TypeVar("_Result")


@dataclass(frozen=True, slots=True)
class Piece(Generic[_Result]):
    """Work for a process, and the file of its result."""

    work: Callable[[], _Result]
    path: Path


def write_record(arrays: Mapping[str, NDArray[Any]], path: Path) -> None:
    """Write a record, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        np.savez(file, allow_pickle=False, **arrays)


def read_record(path: Path) -> dict[str, NDArray[Any]] | None:
    """Read a record, None where there is none; raises OSError where it cannot be read."""
    if not path.exists():
        return None
    try:
        # opened here, as numpy leaves a file that it refuses open
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return dict(stored)
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        raise OSError(f"{path}: {error}; remove it, it is computed anew") from error


def write_results(texts: Mapping[Path, str]) -> None:
    """Write the files that follow from the records; raises OSError."""
    for path, text in texts.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_file(path, text)


def compute(
    title: str,
    missing: Sequence[Piece[_Result]],
    processes: int,
    minutes: float,
    keep: Callable[[_Result, Path], None],
) -> None:
    """Compute and keep these pieces, as many as ``minutes`` allow; 0: all of them."""
    end = time.monotonic() + 60.0 * minutes if minutes else float("inf")
    with ProgressReport(f"{title}: {len(missing)} pieces") as report:
        for done, (piece, result) in enumerate(_finished(missing, processes, end), 1):
            keep(result, piece.path)
            report.at(done / len(missing), piece.path.stem)


def _finished(
    missing: Sequence[Piece[_Result]], processes: int, end: float
) -> Iterator[tuple[Piece[_Result], _Result]]:
    """Yield results as they come; after ``end`` no piece is begun."""
    waiting = itertools.takewhile(lambda _: time.monotonic() < end, missing)
    if processes == 1:
        for piece in waiting:
            yield piece, piece.work()
        return
    with workers(processes) as pool:
        running: dict[Future[_Result], Piece[_Result]] = {}
        while True:
            for piece in itertools.islice(waiting, processes - len(running)):
                running[pool.submit(piece.work)] = piece
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()
