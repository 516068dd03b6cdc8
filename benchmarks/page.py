# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""docs/benchmarks.md, from what was measured."""

import math
from collections.abc import Mapping, Sequence

from benchmarks.lines import BenchmarkLine

_HEAD = """<!--
SPDX-FileCopyrightText: 2026 The terrain_estimator authors
SPDX-License-Identifier: Apache-2.0

Written by `make bench`: run it again, do not edit.
-->
# Benchmarks

Written by `make bench` on {date}: {cores} cores of {processor}, {memory_gb:g} GB, {system}; commit {commit}; load average at the start
{load_average:.1f}. {versions}.

Every figure stands beside a reference that was measured in the same run, so that the ratio says something on another machine too. The
same numbers are in `out/bench.json`. `make bench ARGS="--only reading"` measures one of {names}; with
`ARGS="--scale 0.02"` it shows in minutes that all commands work, and its figures mean nothing.

"""
_AFTER = """
![Time against number of parameters, wheels, bags and run length](images/cost.png)

Both axes of each panel are logarithmic; the dashed line is linear cost. The loops of the simulation and of the training step are in
`benchmarks/numpy_rover.py` and `benchmarks/numpy_training.py`; a test compares their numbers with those of the batched forms.

## What limits the node

The update is one TorchScript module whose tensors hold a few numbers each. `torch.profiler` counts 480 calls of torch's operators in an
update, 4900 in one that closes a block, of one to three microseconds each: the cost is the dispatch of small operations, not their
arithmetic, so it grows little with the number of parameters, and neither more threads nor an accelerator would shorten it. Latency, the
highest rate and replay follow from it. Scalars in C++ would be the way, and a second copy of the physics, which training and simulation
share with the node today.

At 10 Hz a quarter of the node's processor time is the update; two fifths are rclpy's executor, which builds its wait set anew for every
wake-up (py-spy). With rclpy's experimental EventsExecutor it took 3.5 % of a core in a run in which it took 5.4 % without. It is not
used: in this release an exception in one of rclpy's own callbacks, as at a /clock before zero, ends the process with it
(ros2/rclpy#1641), and it does not serve callbacks that are coroutines, as those of the services are (ros2/rclpy#1478).
"""


def page(
    lines: Sequence[BenchmarkLine], machine: Mapping[str, object], names: Sequence[str]
) -> str:
    """The whole page."""
    versions = machine["versions"]
    words = (
        ", ".join(f"{name} {version}" for name, version in versions.items())
        if isinstance(versions, Mapping)
        else ""
    )
    listed = ", ".join(f"`{name}`" for name in names)
    head = _HEAD.format(**{**machine, "versions": words, "names": listed})
    rows = [table_row(line) for line in lines]
    titles = (
        "| what | measured | bar | met | reference | of the reference | ratio"
        " |\n|---|---|---|---|---|---|---|\n"
    )
    return head + titles + "\n".join(rows) + "\n" + _AFTER


def table_row(line: BenchmarkLine) -> str:
    """One line of the table."""
    bar = (
        "" if line.bar is None else f"{'at least' if line.least else 'at most'} {number(line.bar)}"
    )
    met = "" if line.bar is None else "yes" if line.met else "**no**"
    what = f"{line.what} ({line.note})" if line.note else line.what
    cells = (
        what,
        quantity(line),
        bar,
        met,
        line.reference,
        number(line.against),
        number(line.ratio),
    )
    return "| " + " | ".join(cells) + " |"


def quantity(line: BenchmarkLine) -> str:
    """What was measured, with its unit where it has one."""
    return number(line.value) if line.unit == "1" else f"{number(line.value)} {line.unit}"


def number(value: float) -> str:
    """Three digits."""
    if not math.isfinite(value):
        return "not measured" if math.isnan(value) else "infinite"
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
