# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The page of ``make foreign-discovery``."""

from collections.abc import Iterator, Sequence

from studies.foreign_discovery.searched import HELD_OUT, LAW, Searched, errors
from studies.tables import licence, table

INTRODUCTION = """# The missing effect of foreign drives

{measured}

What does find_missing_effect say of drives whose contact law the model lacks? The drives are those
of [bags/foreign](../bags/foreign/README.md): Project Chrono's rover on its SCM terrain, two soils
and three variants of the law. One search for each soil and variant, on the soil file `loose_sand`,
with the prior of the installed model and the noise of [the simulator](simulator.md), seed {seed}.

- The rule for the drives: `{held_out}` is held out, all others of a soil and variant are searched.
- **default**: the candidates of the command without `--library`.
- `tracks` has two drives and none to hold out. A name is unproven there, so the default does not
  try the law at all; a second search has `--library {law}`, and that law alone.
- The searches are those of the command with `--rover-sd exact`, without its bags: the same
  observations, in one process.
- These drives were used to develop `contact_law_scm`: **this is no blind result.**

## Names

"""
NAMES = """
Rollouts and next seconds: root mean square errors, in deviations of the sensors and in what the
model expects, before and after the name; the floor is what a right model has. Brackets are 95 %
limits. Time is that of one core for the search and its proof. A size is in the
[effect's unit](effects.md).

No mass is missing in these drives: the rover weighs what its file says. **A `payload` that is named
from two drives is wrong, and unproven.**

## c and tan phi

Of the searched drives, with nothing missing and with the best name, which may be unproven or, where
the verdict is unknown, only the closest.

"""
SIGNALS = """
## Gap closed by signal

Rollouts of the held-out drive, root mean square errors.

"""
_NAMES = (
    "soil, law",
    "candidates",
    "verdict",
    "best name",
    "rollouts: before, after, floor",
    "closed",
    "next second: before, after",
    "time [s]",
)
_GROUND = (
    "soil, law",
    "candidates",
    "drive",
    "c [Pa]: truth",
    "before",
    "after",
    "tan phi: truth",
    "before",
    "after",
)


def page(every: Sequence[Searched], measured: str, seed: int) -> str:
    """Return the whole page."""
    said = {"measured": measured, "seed": seed, "held_out": HELD_OUT, "law": LAW}
    parts = [licence("foreign-discovery"), INTRODUCTION.format(**said)]
    parts += [table(_NAMES, map(_name, every)), NAMES]
    parts += [table(_GROUND, (line for each in every for line in _grounds(each))), SIGNALS]
    head = ("soil, law", "signal", "unit", "before", "after", "floor", "closed")
    parts.append(table(head, (line for each in every for line in _signals(each))))
    return "".join(parts)


def _name(found: Searched) -> Sequence[str]:
    closed = "-"
    if found.closed is not None:
        share, low, high = (100.0 * each for each in found.closed)
        closed = f"{share:.0f} % ({low:.0f} to {high:.0f})"
    rollout = ", ".join(f"{each:.1f}" for each in found.rollout or ()) or "-"
    ahead = ", ".join(f"{each:.1f}" for each in found.ahead or ()) or "-"
    return (
        found.group.replace("_", ", "),
        found.library,
        found.verdict,
        found.named,
        rollout,
        closed,
        ahead,
        f"{found.seconds:.0f}",
    )


def _grounds(found: Searched) -> Iterator[Sequence[str]]:
    group, (cohesion, friction) = found.group.replace("_", ", "), found.truth
    for drive, before, after in zip(found.drives, found.before, found.after, strict=True):
        yield (
            group, found.library, drive, f"{cohesion:.0f}", f"{before[0]:.0f}", f"{after[0]:.0f}",
            f"{friction:.3f}", f"{before[1]:.3f}", f"{after[1]:.3f}",
        )  # fmt: skip
    before, after = errors(found)
    yield (
        group, found.library, "median error", "", f"{100 * before[0]:.0f} %",
        f"{100 * after[0]:.0f} %", "", f"{100 * before[1]:.0f} %", f"{100 * after[1]:.0f} %",
    )  # fmt: skip


def _signals(found: Searched) -> Iterator[Sequence[str]]:
    for each in found.signals:
        closed = "no gap" if each.closed is None else f"{100.0 * each.closed:.0f} %"
        yield (
            found.group.replace("_", ", "), each.name, each.unit, f"{each.before:.3g}",
            f"{each.after:.3g}", f"{each.floor:.3g}", closed,
        )  # fmt: skip
