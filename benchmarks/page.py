# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The page docs/benchmarks.md."""

import math
from collections.abc import Mapping, Sequence

from benchmarks.lines import BenchmarkLine
from docs.provenance import measured

HEAD = """<!--
SPDX-FileCopyrightText: 2026 The terrain_estimator authors
SPDX-License-Identifier: Apache-2.0

Written by `make bench`: run it again, do not edit.
-->
# Benchmarks

{measured}

How fast is the suite, and does each speed meet its bar? Every figure has a reference that was
measured in the same run, so the ratio means something on another machine too.

- Machine: {cores} cores of {processor}, {memory_gb:g} GB, {system};
  load average at the start {load_average:.1f}.
- Versions: {versions}.
- The same numbers are in `out/bench.json`.
- `make bench ARGS="--only reading"` measures one of
  {names}.
- `make bench ARGS="--scale 0.02"` tests all commands in minutes; its figures are meaningless.

"""
AFTER = """
![Time against number of parameters, wheels, bags and run length](images/cost.png)

Both axes of each panel are logarithmic; the dashed line is linear cost. The reference loops are in
`benchmarks/numpy_rover.py` and `benchmarks/numpy_training.py`. A test compares their numbers with
those of the batched forms.

## What limits the node

A second of ten observations closes in the compiled core with the forces of some 600 wheels: every
hypothesis is expanded at 21 points around its place. A third of its instructions are the integral
over the contact, the rest are small matrices and the start of many small operations on them.
Around the core, Python screens, judges and sums up: on a machine half as fast, 45 us an
observation, and 400 us where a block closes. Half of these 400 us are waits for memory: the core
has filled the cache with its own numbers by then. No single part of Python takes more than 12 us of
a closing.

TorchScript spends its time on the dispatch of small operations, not on their arithmetic: an update
calls hundreds of torch's operators, one that closes a block thousands, and each call takes a
microsecond or more. `torch.profiler` counts them.

Around the estimate, the node's time goes to rclpy: turning bytes into messages, and waiting. Of the
500 us that a set of five messages takes in a backlog, rclpy needs 140 to take them. It makes a
default of every part before it fills the part, four quaternions for the one of an odometry. The
conversion takes 50, the estimator 100. A node that answers without estimating takes 360 in all.

rclpy's executor builds its wait set anew for every wake-up, from each service, timer and event.
The nodes have an executor of their own (`nodes/common/executor.py`), which serves messages without
that and leaves all else to rclpy's. Messages that came meanwhile are served without another wait:
a wait takes 60 us. The node's main thread took 29 ms a second at 10 Hz with it instead of 35, on a
loaded machine. rclpy's EventsExecutor is not used, for two reasons in this release:

- An exception in one of rclpy's own callbacks, as at a /clock before zero, ends the process
  (ros2/rclpy#1641).
- It does not serve callbacks that are coroutines, and those of the services are (ros2/rclpy#1478).
"""


def page(
    lines: Sequence[BenchmarkLine], machine: Mapping[str, object], names: Sequence[str]
) -> str:
    """Return the whole page."""
    versions = machine["versions"]
    words = (
        ", ".join(f"{name} {version}" for name, version in versions.items())
        if isinstance(versions, Mapping)
        else ""
    )
    listed = ", ".join(f"`{name}`" for name in names)
    head = HEAD.format(
        **{**machine, "measured": measured("bench"), "versions": words, "names": listed}
    )
    rows = [table_row(line) for line in lines]
    titles = (
        "| what | measured | bar | met | reference | of the reference | ratio"
        " |\n|---|---|---|---|---|---|---|\n"
    )
    return head + titles + "\n".join(rows) + "\n" + AFTER


def table_row(line: BenchmarkLine) -> str:
    """Return one line of the table."""
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
    """Return the measured value, with its unit where it has one."""
    return number(line.value) if line.unit == "1" else f"{number(line.value)} {line.unit}"


def number(value: float) -> str:
    """Return a number with three digits."""
    if not math.isfinite(value):
        return "not measured" if math.isnan(value) else "infinite"
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
