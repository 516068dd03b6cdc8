# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Work distributed over a dask cluster: a running one by its address, or one on this machine."""

import io
import itertools
import logging
import multiprocessing
import os
import pickle
import queue
import uuid
from collections.abc import Callable, Iterable, Iterator, MutableMapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

if TYPE_CHECKING:
    from distributed import Client, Future

Item = TypeVar("Item")
Result = TypeVar("Result")


class Spread(Protocol):
    """A function that applies another one to every item; results come in the order of the items."""

    def __call__(
        self, function: Callable[[Item], Result], items: Sequence[Item]
    ) -> Iterator[Result]:
        """Yield the result of every item."""


PATIENCE_S = 20.0
"""[s] Time after which a scheduler that does not answer is an error."""

_HERE = {"distributed.worker.profile.enabled": False, "distributed.worker.preload": []}
"""Settings of a worker in this process: its profiler would take a fifth more time."""
_WORKERS = {
    "distributed.worker.profile.enabled": False,
    # Ctrl-C in a terminal reaches the workers, too, which the command ends itself
    "distributed.worker.preload": ["import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)"],
    "distributed.nanny.pre-spawn-environ": {
        "OMP_NUM_THREADS": "1",
        "MKL_NUM_THREADS": "1",
        "MALLOC_TRIM_THRESHOLD_": "1000000000",
        "MALLOC_MMAP_THRESHOLD_": "33554432",
    },
}
"""Settings of the worker processes of this machine.

They keep the memory that they have freed. By dask's default they return it at once, and tensors of
some megabytes then cost as much time in page faults as in arithmetic.
"""


class ClusterError(ValueError):
    """There is no scheduler or worker, or it was lost; the message gives the remedy."""


class WorkerKilledError(ClusterError):
    """An item ended several workers."""


class Sent:
    """Tasks on data that goes to the cluster once, and again only where its worker was lost."""

    def __init__(self, client: "Client") -> None:
        """Use a client, which must stay open."""
        self._client = client
        self._data: dict[int, tuple[object, Future[Any]]] = {}  # by identity, which the data keeps
        self._tensors: MutableMapping[Tensor, Future[Tensor]] = WeakIdKeyDictionary()

    def results(
        self, tasks: Sequence[Callable[..., Result]], data: Sequence[object] | None = None
    ) -> Iterator[tuple[int, Result]]:
        """Yield number and result of every task as they come; each is called with its own data.

        Raises ClusterError, and what a task raised.
        """
        ended: queue.Queue[tuple[int, Future[Result]]] = queue.Queue()
        waiting = set(range(len(tasks)))

        def start(numbers: Iterable[int]) -> None:
            for number in numbers:
                future = self._start(tasks[number], [] if data is None else [data[number]])
                future.add_done_callback(lambda done, number=number: ended.put((number, done)))

        if data is not None:
            self._send(data)
        start(sorted(waiting))
        while waiting:
            number, future = ended.get()
            try:
                result = _result(future)
            except ClusterError as error:
                # a task whose data was on a lost worker is cancelled, too
                if isinstance(error, WorkerKilledError) or not self._connected(error):
                    raise
                if data is not None:
                    self._send(data)
                start([number])
                continue
            waiting.remove(number)
            future.release()
            yield number, result

    def _start(self, task: Callable[..., Result], data: Sequence[object]) -> "Future[Result]":
        packed = io.BytesIO()
        pickler = _Pickler(packed)
        pickler.dump(task)
        parts = [self._part(each) for each in pickler.parts]
        places = [self._data[id(each)][1] for each in data]
        return self._client.submit(_with_parts, packed.getvalue(), parts, places, pure=False)

    def _part(self, tensor: Tensor) -> "Future[Tensor]":
        future = self._tensors.get(tensor)
        if future is None or future.cancelled():
            with _reaching_the_scheduler():
                [future] = self._client.scatter([tensor], hash=False)
            self._tensors[tensor] = future
        return future

    def _send(self, data: Sequence[object]) -> None:
        new = [
            each
            for each in data
            if id(each) not in self._data or self._data[id(each)][1].cancelled()
        ]
        if new:
            with _reaching_the_scheduler():
                futures = self._client.scatter(new, hash=False)
            self._data |= {
                id(each): (each, future) for each, future in zip(new, futures, strict=True)
            }

    def _connected(self, error: ClusterError) -> bool:
        return self._client.status == "running" and _LOST not in str(error)


_LOST = "scheduler-connection-lost"  # reason of dask
LARGE = 16_384
"""[bytes] Size from which a tensor goes to the cluster by itself, once for all tasks."""


class _Pickler(pickle.Pickler):
    """Pickles a task without its large tensors."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file)
        self.parts: list[Tensor] = []

    def persistent_id(self, value: Any) -> int | None:  # noqa: ANN401
        if isinstance(value, Tensor) and value.nbytes >= LARGE:
            self.parts.append(value)
            return len(self.parts) - 1
        return None


class _Unpickler(pickle.Unpickler):  # noqa: S301 (of the client, as all of dask)
    """Reads a task of the client, which dask would unpickle likewise."""

    parts: Sequence[Tensor] = ()

    def persistent_load(self, number: Any) -> Tensor:  # noqa: ANN401 (as pickle has it)
        return self.parts[number]


def _with_parts(packed: bytes, parts: Sequence[Tensor], data: Sequence[object]) -> Any:  # noqa: ANN401
    torch.set_num_threads(1)
    unpickler = _Unpickler(io.BytesIO(packed))
    unpickler.parts = parts
    return unpickler.load()(*data)


class Cluster:
    """A :class:`Spread` over the workers of a client."""

    def __init__(self, client: "Client") -> None:
        """Use a client, which must stay open."""
        self._client = client
        # the scheduler remembers every group of keys, also one that begins anew when it was empty:
        # one group, with a task that stays, keeps that from growing
        self._keys = zip(itertools.repeat(f"item-{uuid.uuid4().hex}"), itertools.count())
        self._stays: Future[int] | None = None

    def __call__(
        self, function: Callable[[Item], Result], items: Sequence[Item]
    ) -> Iterator[Result]:
        """Yield the result of every item, in the order of the items."""
        for future in self._submitted(function, items):
            yield _result(future)
            future.release()

    def sent(self) -> Sent:
        """Return a place for tasks on data that is sent once."""
        return Sent(self._client)

    @property
    def threads(self) -> int:
        """Number of threads of all workers, which may come and go. Raises ClusterError."""
        with _reaching_the_scheduler():
            return sum(self._client.nthreads().values())

    def start(self, function: Callable[[Item], Result], item: Item) -> "Future[Result]":
        """Begin one item; :meth:`result` takes what comes of it."""
        if self._stays is None:
            self._stays = self._client.submit(int, key=next(self._keys))
        return self._client.submit(_alone, function, item, key=next(self._keys), pure=False)

    @staticmethod
    def result(future: "Future[Result]") -> Result:
        """Return the result of :meth:`start`.

        Raises ClusterError, and what the function raised.
        """
        return _result(future)

    def _submitted(
        self, function: Callable[[Item], Result], items: Sequence[Item]
    ) -> "list[Future[Result]]":
        # pure=False: a repeated item is computed again, nothing is cached under its contents
        return self._client.map(_alone, [function] * len(items), items, pure=False)


@contextmanager
def cluster(scheduler: str, workers: int | None = None) -> Iterator[Cluster]:
    """Spread work over the cluster of the ``scheduler`` (host:port), or over this machine for "".

    On this machine there are ``workers`` processes with one thread, by default one for each CPU. A
    process that may start no others does the work itself, one item at a time. Raises ClusterError
    where no scheduler answers or it has no worker, and where such a process is given ``workers``.
    """
    # distributed takes a second to import, and most commands do not need it
    from dask import config  # noqa: PLC0415
    from distributed import Client, LocalCluster  # noqa: PLC0415

    # it logs at length what a ClusterError says
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
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
    alone = not may_start_others()
    if alone and workers and workers > 1:
        raise ClusterError("--workers: this process may start no others: leave it out")
    count = 1 if alone else workers or os.cpu_count() or 1
    with (
        config.set(_HERE if alone else _WORKERS),
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            processes=not alone,
            dashboard_address="127.0.0.1:0",
        ) as local,
        Client(local) as client,
    ):
        yield Cluster(client)


def may_start_others() -> bool:
    """Return whether this process may start others; a daemonic one, as dask's workers, may not."""
    return not multiprocessing.current_process().daemon


@contextmanager
def _reaching_the_scheduler() -> Iterator[None]:
    try:
        yield
    except (CancelledError, OSError) as error:
        raise ClusterError(f"the scheduler was lost: {error}") from error


def _result(future: "Future[Result]") -> Result:
    from distributed import KilledWorker  # noqa: PLC0415 (see above)

    with _reaching_the_scheduler():
        raised = future.exception()
        if raised is None:
            return future.result()
    if isinstance(raised, KilledWorker):
        raise WorkerKilledError(
            f"{raised} Memory is the usual cause: use fewer workers, or give them more"
        ) from raised
    raise raised


def _alone(function: Callable[[Item], Result], item: Item) -> Result:
    """Apply a function with one thread of torch, so that sums have the same order everywhere."""
    torch.set_num_threads(1)
    return function(item)
