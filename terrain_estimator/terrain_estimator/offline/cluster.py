# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Work distributed over a dask cluster: a running one by its address, or one on this machine."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import torch

if TYPE_CHECKING:
    from distributed import Client, Future

Item = TypeVar("Item")
Kept = TypeVar("Kept")
Result = TypeVar("Result")


class Spread(Protocol):
    """A function that applies another one to every item; results come in the order of the items."""

    def __call__(
        self, function: Callable[[Item], Result], items: Sequence[Item]
    ) -> Iterator[Result]:
        """Yield the result of every item."""


PATIENCE_S = 20.0
"""[s] Time after which a scheduler that does not answer is an error."""

_WORKERS = {
    "distributed.worker.profile.enabled": False,
    "distributed.nanny.pre-spawn-environ": {
        "OMP_NUM_THREADS": "1",
        "MKL_NUM_THREADS": "1",
        "MALLOC_TRIM_THRESHOLD_": "1000000000",
        "MALLOC_MMAP_THRESHOLD_": "33554432",
    },
}
"""Settings of the workers of this machine.

They keep the memory that they have freed. By dask's default they return it at once, and tensors of
some megabytes then cost as much time in page faults as in arithmetic. The profiler would take a
fifth more.
"""


class ClusterError(ValueError):
    """There is no scheduler or worker, or it was lost; the message gives the remedy."""


class Held(Generic[Kept]):
    """Results that stay on the workers that computed them; lost ones are computed again."""

    def __init__(self, client: "Client", kept: "Sequence[Future[Kept]]") -> None:
        """Hold futures on the client's cluster."""
        self._client, self._kept = client, kept

    def fetch(self) -> Iterator[Kept]:
        """Return copies of all results in order."""
        return map(_result, self._kept)

    def chosen(self, numbers: Sequence[int]) -> "Held[Kept]":
        """Return only these results."""
        return Held(self._client, [self._kept[number] for number in numbers])

    def __call__(
        self, function: Callable[[Kept, Item], Result], items: Sequence[Item]
    ) -> list[Result]:
        """Return ``function`` of every held result and its item, computed on its worker."""
        futures = self._client.map(
            _alone_with, [function] * len(items), self._kept, items, pure=False
        )
        return [_result(future) for future in futures]


class Cluster:
    """A :class:`Spread` over the workers of a client."""

    def __init__(self, client: "Client") -> None:
        """Use a client, which must stay open."""
        self._client = client

    def __call__(
        self, function: Callable[[Item], Result], items: Sequence[Item]
    ) -> Iterator[Result]:
        """Yield the result of every item, in the order of the items."""
        for future in self._submitted(function, items):
            yield _result(future)
            future.release()

    def hold(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Held[Result]:
        """Compute the results of all items, and leave them on the workers."""
        return Held(self._client, self._submitted(function, items))

    def _submitted(
        self, function: Callable[[Item], Result], items: Sequence[Item]
    ) -> "list[Future[Result]]":
        # pure=False: a repeated item is computed again, nothing is cached under its contents
        return self._client.map(_alone, [function] * len(items), items, pure=False)


@contextmanager
def cluster(scheduler: str, workers: int | None = None) -> Iterator[Cluster]:
    """Spread work over the cluster of the ``scheduler`` (host:port), or over this machine for "".

    On this machine there are ``workers`` processes with one thread, by default one for each CPU.
    Raises ClusterError where no scheduler answers or it has no worker.
    """
    # distributed takes a second to import, and most commands do not need it
    from dask import config  # noqa: PLC0415
    from distributed import Client, LocalCluster  # noqa: PLC0415

    if scheduler:
        try:
            client = Client(scheduler, timeout=PATIENCE_S)
        except (OSError, ValueError) as error:
            raise ClusterError(
                f"--scheduler {scheduler}: {error}; start one with `dask scheduler`, and workers"
                " that can import this package"
            ) from error
        with client:
            try:
                client.wait_for_workers(1, timeout=PATIENCE_S)
            except TimeoutError as error:
                raise ClusterError(
                    f"--scheduler {scheduler}: it has no worker; start some with"
                    f" `dask worker {scheduler}`"
                ) from error
            yield Cluster(client)
        return
    count = workers or os.cpu_count() or 1
    with (
        config.set(_WORKERS),
        LocalCluster(
            n_workers=count, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
        ) as local,
        Client(local) as client,
    ):
        yield Cluster(client)


def _result(future: "Future[Result]") -> Result:
    from distributed import KilledWorker  # noqa: PLC0415 (see above)

    try:
        return future.result()
    except KilledWorker as error:
        raise ClusterError(
            f"{error} Memory is the usual cause: use fewer workers, or give them more"
        ) from error
    except CancelledError as error:
        raise ClusterError(f"the scheduler was lost: {error}") from error


def _alone(function: Callable[[Item], Result], item: Item) -> Result:
    """Apply a function with one thread of torch, so that sums have the same order everywhere."""
    torch.set_num_threads(1)
    return function(item)


def _alone_with(function: Callable[[Kept, Item], Result], kept: Kept, item: Item) -> Result:
    torch.set_num_threads(1)
    return function(kept, item)
