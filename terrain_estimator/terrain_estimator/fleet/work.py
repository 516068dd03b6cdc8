# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Replay all bags of a fleet on a cluster, each content once, with little of it in memory."""

import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from terrain_estimator.console.progress import ProgressReport
from terrain_estimator.fleet.journal import Journal
from terrain_estimator.fleet.sources import FleetError, FoundBag, find_bags
from terrain_estimator.fleet.tables import FleetTables
from terrain_estimator.fleet.task import (
    DAMAGED,
    EQUAL,
    ESTIMATE,
    FAILED,
    NO_ESTIMATE,
    OTHER_TOPICS,
    THIS,
    BagResult,
    Failure,
)
from terrain_estimator.offline.cluster import Cluster, WorkerKilledError

if TYPE_CHECKING:
    from distributed import Future

LISTED = 1000  # bags between the listing and the journal
AHEAD = 2  # tasks for each thread of a worker, so that none waits for the next one
TURN_S = 0.2
PART_S, PART_BAGS = 60.0, 500
"""[s], [1] A part of the tables is written after this time or number of results."""
COUNT_S = 5.0  # between two looks at the workers

Found = TypeVar("Found")
ContentOf: TypeAlias = Callable[[FoundBag], str | Failure]
Replayed: TypeAlias = Callable[[FoundBag], BagResult | Failure]


@dataclass(slots=True)
class _Job:
    number: int
    bag: FoundBag
    sha256: str = ""  # empty where it is not known yet


class Listing:
    """The bags of all sources, found in a thread of its own."""

    def __init__(self, sources: Sequence[str]) -> None:
        """Begin to list."""
        self._found: queue.Queue[FoundBag | str | FleetError | None] = queue.Queue(LISTED)
        self._ended = threading.Event()
        self.done = False
        self.troubled = False
        threading.Thread(
            target=self._list, args=(tuple(sources),), name="listing", daemon=True
        ).start()

    def _list(self, sources: tuple[str, ...]) -> None:
        try:
            for source in sources:
                for bag in find_bags(source, self._give):
                    self._give(bag)
            self._give(None)
        except FleetError as error:
            self._give(error)
        except Exception as error:  # noqa: BLE001 - raised again by take()
            self._give(FleetError(f"the listing ended unexpectedly: {error!r}"))

    def _give(self, item: FoundBag | str | FleetError | None) -> None:
        while not self._ended.is_set():
            try:
                self._found.put(item, timeout=1.0)
            except queue.Full:
                continue
            return

    def take(self, say: Callable[[str], None]) -> list[FoundBag]:
        """Return what was found since the last call; FleetError where a source is wrong."""
        bags = list[FoundBag]()
        while not self.done and len(bags) < LISTED:
            try:
                item = self._found.get_nowait()
            except queue.Empty:
                break
            if isinstance(item, FleetError):
                raise item
            if isinstance(item, str):
                self.troubled = True
                say(item)
            elif item is None:
                self.done = True
            else:
                bags.append(item)
        return bags

    def end(self) -> None:
        """Let the thread end."""
        self._ended.set()


class Dispatch:
    """Bags under way: at most a few for each worker.

    A bag whose size no other one has is replayed at once. Others are hashed first: where their
    content has a result, or is under way, they are not replayed.
    """

    def __init__(
        self, cluster: Cluster, journal: Journal, content_of: ContentOf, replayed: Replayed
    ) -> None:
        """Run ``content_of`` and ``replayed`` on the workers."""
        self._cluster, self._journal = cluster, journal
        self._content_of, self._replayed = content_of, replayed
        self._hashing: dict[Future[Any], _Job] = {}
        self._replaying: dict[Future[Any], _Job] = {}
        self._parked: list[_Job] = []
        self._ended: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
        self._last = 0
        self._threads, self._counted_s = cluster.threads, time.monotonic()

    @property
    def under_way(self) -> int:
        """Number of bags that were begun and are not finished."""
        return len(self._hashing) + len(self._replaying) + len(self._parked)

    @property
    def threads(self) -> int:
        """Number of threads of all workers, which may come and go."""
        if time.monotonic() - self._counted_s > COUNT_S:
            self._threads, self._counted_s = self._cluster.threads, time.monotonic()
        return self._threads

    def fill(self) -> None:
        """Begin as many of the waiting bags as the workers need."""
        while self.under_way < AHEAD * max(1, self.threads):
            found = self._journal.next(self._last)
            if found is None:
                return
            self._last, bag = found
            job = _Job(self._last, bag)
            if self._journal.has_size(bag):
                self._start(self._hashing, self._content_of, job)
            else:
                self._start(self._replaying, self._replayed, job)

    def results(self, say: Callable[[str], None]) -> None:
        """Take the results that have come, after waiting for the first one for a while."""
        wait_s = TURN_S
        while True:
            try:
                future = self._ended.get(timeout=wait_s)
            except queue.Empty:
                return
            wait_s = 0.0
            if job := self._hashing.pop(future, None):
                self._hashed(job, self._result(job, future), say)
            elif job := self._replaying.pop(future, None):
                self._keep(job, self._result(job, future), say)
                parked, self._parked = self._parked, []
                for each in parked:
                    self._settle(each, say)
            future.release()

    def _result(self, job: _Job, future: "Future[Found]") -> Found | Failure:
        try:
            return self._cluster.result(future)
        except WorkerKilledError as error:
            return Failure(f"{job.bag.name}: {error}")

    def _start(
        self,
        under_way: "dict[Future[Any], _Job]",
        function: Callable[[FoundBag], Any],
        job: _Job,
    ) -> None:
        future = self._cluster.start(function, job.bag)
        under_way[future] = job
        future.add_done_callback(self._ended.put)

    def _hashed(self, job: _Job, found: str | Failure, say: Callable[[str], None]) -> None:
        if isinstance(found, Failure):
            self._fail(job, found, say)
        else:
            job.sha256 = found
            self._settle(job, say)

    def _settle(self, job: _Job, say: Callable[[str], None]) -> None:
        """Replay a bag whose hash is known, unless its content is known or may become so."""
        if self._journal.owner(job.sha256, job.bag.name):
            self._journal.finish_equal(job.number, job.sha256)
            self._say_equal(job, job.sha256, say)
        elif any(
            other.sha256 == job.sha256 or (not other.sha256 and other.bag.size == job.bag.size)
            for other in self._replaying.values()
        ):
            self._parked.append(job)
        else:
            self._start(self._replaying, self._replayed, job)

    def _keep(self, job: _Job, found: BagResult | Failure, say: Callable[[str], None]) -> None:
        if isinstance(found, Failure):
            self._fail(job, found, say)
            return
        if self._journal.owner(found.sha256, job.bag.name):  # the file changed meanwhile
            self._journal.finish_equal(job.number, found.sha256)
            self._say_equal(job, found.sha256, say)
            return
        self._journal.finish(job.number, found)
        if found.outcome in {DAMAGED, OTHER_TOPICS}:
            say(str(found.values["message"]).replace(THIS, job.bag.name))

    def _fail(self, job: _Job, failure: Failure, say: Callable[[str], None]) -> None:
        self._journal.fail(job.number, failure.message)
        say(f"{failure.message}; the same command tries it again")

    def _say_equal(self, job: _Job, sha256: str, say: Callable[[str], None]) -> None:
        other = self._journal.owner(sha256, job.bag.name)
        say(f"{job.bag.name} has the content of {other}: it is counted once")


@contextmanager
def _listing(sources: Sequence[str]) -> Iterator[Listing]:
    listing = Listing(sources)
    try:
        yield listing
    finally:
        listing.end()


def work(dispatch: Dispatch, journal: Journal, tables: FleetTables, sources: Sequence[str]) -> bool:
    """List and replay everything; return whether everything could be listed.

    What has come is in the tables also after an error.

    Raises:
        FleetError: a source is wrong, or a worker has another model.
        ClusterError: the scheduler was lost.
    """
    with _listing(sources) as listing, ProgressReport("fleet") as report:

        def say(line: str) -> None:
            report.say(f"fleet: {line}")

        written_s, written = time.monotonic(), journal.found - journal.left
        try:
            while not listing.done or journal.left:
                journal.add(listing.take(say))
                dispatch.fill()
                dispatch.results(say)
                _tell(report, journal, listing, dispatch)
                late = time.monotonic() - written_s > PART_S
                if late or journal.found - journal.left - written > PART_BAGS:
                    tables.add_part()
                    written_s, written = time.monotonic(), journal.found - journal.left
        finally:
            tables.add_part()
    return not listing.troubled


def _tell(report: ProgressReport, journal: Journal, listing: Listing, dispatch: Dispatch) -> None:
    counts = journal.counts
    done = counts[ESTIMATE] + counts[NO_ESTIMATE]
    damaged = counts[DAMAGED] + counts[OTHER_TOPICS] + counts[FAILED]
    more = "" if listing.done else " and more"
    idle = "" if dispatch.threads else "; no worker: start some"
    report.at(
        (journal.found - journal.left) / max(1, journal.found),
        f"{done} done, {damaged} damaged, {counts[EQUAL]} equal, {journal.left}{more} left{idle}",
    )
