# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Work spread over a dask.distributed cluster: a running one by its address, or one on this machine."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol, TypeVar

import torch
from distributed import Client, LocalCluster

Item = TypeVar("Item")
Result = TypeVar("Result")


class Spread(Protocol):
    """Applies a function to every item; the results come in the order of the items, whoever computed them."""

    def __call__(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """The result of every item."""


PATIENCE_S = "20s"
"""Until a scheduler that does not answer is an error."""


class ClusterError(ValueError):
    """There is no scheduler at the address; the message says what to do."""


@contextmanager
def cluster(scheduler: str, workers: int | None = None) -> Iterator[Spread]:
    """A way to spread work over the cluster of the ``scheduler`` (host:port), or for "" over processes of this machine.

    On this machine there are ``workers`` processes of one thread, by default one for each CPU. Raises ClusterError where
    no scheduler answers.
    """
    if scheduler:
        try:
            client = Client(scheduler, timeout=PATIENCE_S)
        except (OSError, ValueError) as error:
            raise ClusterError(
                f"--scheduler {scheduler}: {error}; start one with `dask scheduler`, and workers that import this package"
            ) from error
        with client:
            yield _spread_over(client)
        return
    count = workers or os.cpu_count() or 1
    with (
        LocalCluster(n_workers=count, threads_per_worker=1, processes=True, dashboard_address=None) as local,
        Client(local) as client,
    ):
        yield _spread_over(client)


def _spread_over(client: Client) -> Spread:
    def spread(function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        # pure=False: the same item asked for twice is computed twice, nothing is kept under a key of its contents
        futures = client.map(_alone, [function] * len(items), items, pure=False)
        for future in futures:
            yield future.result()
            future.release()

    return spread


def _alone(function: Callable[[Item], Result], item: Item) -> Result:
    """One item with one thread of torch, so that sums are added in the same order everywhere."""
    torch.set_num_threads(1)
    return function(item)
