# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Place where the runs of a discovery are read and evaluated: this process, or a cluster.

On a cluster every finished piece is on the disk before it counts. A run goes to the cluster once,
and again only where its worker was lost.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from rover_parameters.records import ConfigError
from terrain_estimator.bags import METADATA_FILE
from terrain_estimator.discovery.hypotheses.contributions import Contributions, Item, Result, here
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.runs import Blocks
from terrain_estimator.offline.bag_options import BagOptions
from terrain_estimator.offline.cluster import Cluster, cluster, may_start_others
from terrain_estimator.offline.digest import code_sha256, digest
from terrain_estimator.offline.pieces import Pieces, pack, unpack
from terrain_estimator.offline.provenance import bag_sha256
from terrain_estimator.offline.reading_runs import ReadRun, read_run_of

FEW = 16
"""Number of bags up to which this process works alone, unless a cluster is named.

With ten bags of 30 s two workers gained nothing.
"""
JOURNAL = "search.sqlite"
"""Name of the file of finished pieces in the folder of the results."""


@dataclass(frozen=True, slots=True)
class Runs:
    """Runs that can be used, the computation of their contributions, and reasons for the others."""

    blocks: list[Blocks]
    contributions: Contributions
    left_out: list[str]
    damaged: dict[str, str]  # what is missing, by the name of the run, used or not


class Workplace(Protocol):
    """Place where bags are read and searched."""

    def read(
        self, nominals: Sequence[Nominal], bags: Sequence[Path], read: Callable[..., ReadRun]
    ) -> tuple[Iterable[ReadRun], Callable[[Sequence[int], Sequence[Blocks]], Contributions]]:
        """Return what was read, and the contributions of the chosen numbers of runs."""


class Here:
    """This process."""

    def read(
        self, nominals: Sequence[Nominal], bags: Sequence[Path], read: Callable[..., ReadRun]
    ) -> tuple[Iterable[ReadRun], Callable[[Sequence[int], Sequence[Blocks]], Contributions]]:
        """Read one bag after the other."""
        return map(read, nominals, bags), lambda _, blocks: here(blocks)


class OnCluster:
    """The workers of a cluster, whose results are kept."""

    def __init__(self, on: Cluster, pieces: Pieces) -> None:
        """Use a cluster, and the pieces that are finished already."""
        self._sent, self._pieces = on.sent(), pieces

    def read(
        self, nominals: Sequence[Nominal], bags: Sequence[Path], read: Callable[..., ReadRun]
    ) -> tuple[Iterable[ReadRun], Callable[[Sequence[int], Sequence[Blocks]], Contributions]]:
        """Read each bag on a worker, which must have it at the same path."""
        # a worker may have another working directory
        files = [bag.absolute() for bag in bags]
        keys = [
            digest((read, *each))
            for each in zip(nominals, files, map(_content, files), strict=True)
        ]
        found = self._all(
            keys, [partial(read, *each) for each in zip(nominals, files, strict=True)]
        )

        def contributions(numbers: Sequence[int], blocks: Sequence[Blocks]) -> Contributions:
            names, held = [keys[number] for number in numbers], list(blocks)

            def of_runs(
                function: Callable[[Blocks, Item], Result], items: Sequence[Item], /
            ) -> list[Result]:
                task = digest(function)
                pieces = [
                    digest((task, name, item)) for name, item in zip(names, items, strict=True)
                ]
                work = [partial(_of_run, function, item=item) for item in items]
                return list(self._all(pieces, work, held))

            return of_runs

        return found, contributions

    def _all(
        self,
        keys: Sequence[str],
        work: Sequence[Callable[..., Any]],
        runs: Sequence[Blocks] | None = None,
    ) -> Iterator[Any]:
        """Yield the result of every piece in order; the cluster computes those that are missing."""
        found = [self._pieces.get(key) for key in keys]
        missing = [number for number, each in enumerate(found) if each is None]
        tasks = [partial(_packed, work[number], keys[number], code_sha256()) for number in missing]
        data = [runs[number] for number in missing] if runs is not None else None
        for place, result in self._sent.results(tasks, data):
            self._pieces.put(keys[missing[place]], result)
            found[missing[place]] = result
        return (unpack(each) for each in found if each is not None)


def _of_run(function: Callable[[Blocks, Item], Result], run: Blocks, *, item: Item) -> Result:
    return function(run, item)


def _packed(work: Callable[..., Any], key: str, code: str, *run: Blocks) -> bytes:
    """Compute the piece of this key, which nothing but an observer of workers looks at."""
    del key
    if code != code_sha256():
        raise ConfigError(
            f"a worker has other code ({code_sha256()[:12]}) than this command ({code[:12]}):"
            " install the same version on both"
        )
    return pack(work(*run))


def _content(bag: Path) -> str:
    """Return the hash of everything that is read of a bag."""
    beside = bag / METADATA_FILE if bag.is_dir() else bag.parent / METADATA_FILE
    return f"{bag_sha256(bag)} {bag_sha256(beside) if beside.is_file() else ''}"


def contents_of(bags: Sequence[Path]) -> dict[str, str]:
    """Return the hash of each bag, by a name for an error."""
    return {f"content of {bag.absolute()}": _content(bag.absolute()) for bag in bags}


def read_all(
    place: Workplace,
    bags: Sequence[Path],
    nominals: Sequence[Nominal],
    reading: BagOptions,
    say: ProgressCallback,
    *,
    held_out: bool = False,
    take_damaged: bool = False,
) -> Runs:
    """Read the runs of these bags in order, each with the nominal model of its soil."""
    read = partial(read_run_of, reading=reading, held_out=held_out, take_damaged=take_damaged)
    found, contributions = place.read(nominals, bags, read)
    blocks, numbers, left_out, damaged = [], [], [], {}
    for number, (each, bag) in enumerate(zip(found, bags, strict=True)):
        say(number / len(bags), f"reading {bag}")
        if each.lost:
            damaged[bag.name] = each.lost
        if each.blocks is None:
            left_out.append(f"{bag} is left out: {each.reason}")
        else:
            blocks.append(each.blocks)
            numbers.append(number)
    return Runs(blocks, contributions(numbers, blocks), left_out, damaged)


@contextmanager
def workplace(
    bags: int, scheduler: str, workers: int, out: Path, identity: Callable[[], Mapping[str, Any]]
) -> Iterator[tuple[Workplace, Pieces | None]]:
    """Choose the place for a number of bags.

    It is the cluster of a ``scheduler``, else ``workers`` processes of this machine; 0 chooses a
    number that pays. On a cluster finished pieces are in the folder ``out``, which exists.

    Raises:
        ClusterError: the scheduler does not answer.
        JournalError: the pieces in ``out`` are of a search with another ``identity``.
        ConfigError: this process may not start others.
    """
    alone = not may_start_others()
    if not scheduler and (workers == 1 or (not workers and (bags <= FEW or alone))):
        yield Here(), None
        return
    if alone and not scheduler:
        raise ConfigError("--workers: this process may start no others: leave it out")
    with cluster(scheduler, workers or None) as on, Pieces(out / JOURNAL, identity()) as pieces:
        yield OnCluster(on, pieces), pieces


def refuse_equal(runs: Sequence[Blocks]) -> None:
    """Raise ConfigError where two runs share more than half of the seconds of one of them.

    A copy under another name, or a part of a run, would count its measurements twice.
    """
    owner: dict[int, int] = {}
    shared: Counter[tuple[int, int]] = Counter()
    for number, run in enumerate(runs):
        for second in run.packed:
            first = owner.setdefault(hash(second.numpy().tobytes()), number)
            shared[first, number] += first != number
    for (first, number), count in shared.items():
        fewest = min(len(runs[first].packed), len(runs[number].packed))
        if 2 * count > fewest:
            raise ConfigError(
                f"runs {runs[first].name} and {runs[number].name} have {count} of {fewest} seconds"
                " in common: every measurement counts once; give one of them"
            )
