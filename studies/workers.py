# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Processes that share a long computation."""

import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context

import torch


@contextmanager
def workers(count: int) -> Iterator[ProcessPoolExecutor]:
    """Start ``count`` processes of one thread each; an exception in the context kills them."""
    with ProcessPoolExecutor(count, get_context("spawn"), _begin) as pool:
        try:
            yield pool
        except BaseException:
            for process in active_children():
                process.kill()
            raise


def _begin() -> None:
    torch.set_num_threads(1)
    # Ctrl-C reaches every process; only the first one reports it
    signal.signal(signal.SIGINT, signal.SIG_DFL)
