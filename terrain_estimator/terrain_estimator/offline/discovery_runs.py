# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Read the runs of a discovery from bags, with the estimator's own pairing and conversion.

The bags are read here, or each on a worker that keeps its run.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import cast

from rover_parameters.records import ConfigError
from terrain_estimator.bags import BagError, BagReader
from terrain_estimator.discovery.hypotheses.contributions import Contributions, here
from terrain_estimator.discovery.hypotheses.rows import Nominal
from terrain_estimator.discovery.progress import ProgressCallback
from terrain_estimator.discovery.proof.held_out import long_enough
from terrain_estimator.discovery.runs import Blocks, RecordedRun, Refusals, RunError, cut, run_of
from terrain_estimator.messaging.averaging import Averager, averaged
from terrain_estimator.messaging.conversion import Converter
from terrain_estimator.messaging.pairing import MessageSet, input_synchronizer
from terrain_estimator.observation import Observation
from terrain_estimator.offline.bag_options import BagOptions
from terrain_estimator.offline.cluster import Cluster, Held, Item, Result, cluster
from terrain_estimator.offline.topic_mapping import TopicError, check_inputs
from terrain_estimator.topics import INPUT_TYPES, REQUIRED_INPUTS, stamp_ns
from terramechanics.vehicle.rover import Rover

FEW = 16
"""Number of bags up to which this process works alone, unless a cluster is named.

With ten bags of 30 s two workers gained nothing.
"""


@dataclass(frozen=True, slots=True)
class Runs:
    """Runs that can be used, the computation of their contributions, and reasons for the others."""

    blocks: list[Blocks]
    contributions: Contributions
    left_out: list[str]


class Workplace:
    """Place where bags are read and searched: this process, or workers that keep what they read."""

    def __init__(self, on: Cluster | None) -> None:
        """Use a cluster, or this process for None."""
        self._cluster = on

    def spread(self, function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """Yield a function of every item, in order."""
        return (self._cluster or map)(function, items)

    def read(
        self,
        bags: Sequence[Path],
        nominal: Nominal,
        reading: BagOptions,
        say: ProgressCallback,
        *,
        held_out: bool = False,
    ) -> Runs:
        """Read the runs of these bags in order; held-out runs must be long enough to halve."""
        read = partial(read_blocks, nominal, reading=reading, held_out=held_out)
        files = [bag.absolute() for bag in bags]  # a worker may have another working directory
        if self._cluster is None:
            blocks, _, left_out = _sorted_out(map(read, files), bags, say)
            return Runs(blocks, here(blocks), left_out)
        held = self._cluster.hold(read, files)
        blocks, numbers, left_out = _sorted_out(held.fetch(), bags, say)
        return Runs(blocks, cast("Held[Blocks]", held.chosen(numbers)), left_out)


@contextmanager
def workplace(bags: int, scheduler: str, workers: int) -> Iterator[Workplace]:
    """Choose the place for a number of bags.

    It is the cluster of a ``scheduler``, else ``workers`` processes of this machine; 0 chooses a
    number that pays. Raises ClusterError where the scheduler does not answer.
    """
    if not scheduler and (workers == 1 or (not workers and bags <= FEW)):
        yield Workplace(None)
        return
    with cluster(scheduler, workers or None) as spread:
        yield Workplace(spread)


def _sorted_out(
    found: Iterable[Blocks | str], bags: Sequence[Path], say: ProgressCallback
) -> tuple[list[Blocks], list[int], list[str]]:
    """Sort out the runs: usable ones, their numbers, and the reasons for the others."""
    blocks, numbers, left_out = [], [], []
    for number, (each, bag) in enumerate(zip(found, bags, strict=True)):
        say(number / len(bags), f"reading {bag}")
        if isinstance(each, str):
            left_out.append(f"{bag} is left out: {each}")
        else:
            blocks.append(each)
            numbers.append(number)
    return blocks, numbers, left_out


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


def read_blocks(
    nominal: Nominal, bag: Path, *, reading: BagOptions | None = None, held_out: bool = False
) -> Blocks | str:
    """Return the blocks of a run, or the reason why it cannot be used.

    Without ``reading`` the estimator's own topics and parameters apply.
    """
    try:
        blocks = cut(read_run(bag, nominal.rover, reading or BagOptions()), nominal.contact)
        return long_enough(blocks) if held_out else blocks
    except (BagError, TopicError, RunError, OSError) as error:
        return str(error)


def read_run(bag: Path, rover: Rover, reading: BagOptions) -> RecordedRun:
    """Read the run of a bag.

    Raises:
        BagError: it cannot be read.
        TopicError: a required topic is missing.
        RunError: no observation can be used; the message gives the reason.
    """
    names = reading.names
    with BagReader(bag) as reader:
        check_inputs(str(bag), reader.topics, names)
        reader.expect({names[name]: type_name for name, type_name in INPUT_TYPES.items()})
        refusals = Refusals()
        return run_of(
            bag.name,
            _observations(reader, rover, reading, refusals),
            rover,
            reading.config.core,
            refusals,
        )


def _observations(
    reader: BagReader, rover: Rover, reading: BagOptions, refusals: Refusals
) -> Iterator[Observation]:
    """Yield the observations of a bag at 10 Hz; RunError where no messages are of one instant."""
    used = reading.config.core
    converter = Converter(rover, reading.config.conversion, used)
    none = True
    readings = (
        converter.convert(complete.stamp_ns, complete.messages)
        for complete in _paired(reader, reading, converter)
    )
    for converted in averaged(readings, Averager(rover.wheel_radius, used)):
        none = False
        if converted.observation is None:
            refusals.add(converted.outcome, converted.detail)
        else:
            yield (
                converted.observation
                if used.use_moments
                else replace(converted.observation, bogie_angle=math.nan)
            )
    if none:
        raise RunError(
            f"no {', '.join(REQUIRED_INPUTS)} have stamps within the parameter pairing_tolerance,"
            f" {reading.config.pairing.tolerance_s:g} s: give the estimator's value (-p or"
            " --params-file)"
        )


def _paired(reader: BagReader, reading: BagOptions, converter: Converter) -> Iterator[MessageSet]:
    synchronizer = input_synchronizer(INPUT_TYPES, reading.config.pairing)
    index = {reading.names[name]: (number, name) for number, name in enumerate(INPUT_TYPES)}
    for raw in reader.messages(index):
        (number, name), message = index[raw.topic], reader.decode(raw)
        # otherwise a mast or an arm would take the partners of the wheels
        if converter.concerns(name, message):
            yield from synchronizer.add(
                number, stamp_ns(message), message, getattr(message, "sequence", None)
            )
    yield from synchronizer.flush()
