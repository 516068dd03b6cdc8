# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The page docs/hidden.md."""

from collections import Counter
from collections.abc import Sequence

from docs.provenance import measured
from tests.hidden.judge.bars import (
    bars,
    conditions,
    constants_found,
    field_bars,
    outcomes,
    rover_bars,
    told_and_untold,
)
from tests.hidden.judge.judging import Record
from tests.hidden.judge.strata import UNTOLD

INTRODUCTION = """<!--
SPDX-FileCopyrightText: 2026 The terrain_estimator authors
SPDX-License-Identifier: Apache-2.0

Written by `make hidden`: run it again, do not edit.
-->
# How often the verdict is right

{measured}

How often does `find_missing_effect` name a hidden effect correctly, and how often does it name one
where nothing is hidden? {done} of the {wanted} cases that were asked for are done.
Where the line above says that the code has changed, these figures are of an older rule; for the
present one see [conditions drawn at random](#conditions-drawn-at-random).

- [discovery.md](discovery.md) explains how a verdict is found, [effects.md](effects.md) the effects
  and the size at which each matters. The hidden laws are in [tests/hidden](../tests/hidden); they
  differ from those of the library.
- A case is five one-minute drives on one soil, whose constants are up to 5 % wrong. Half of the
  cases are on hills. Four drives are analysed, the fifth is held out for the proof.
- Limits are Clopper-Pearson, 95 %; those of medians and ratios are bootstrapped.

"""
VERDICTS = """## Verdicts

A verdict is right in these cases:

| hidden | right verdict |
|---|---|
| nothing | "none" |
| an effect of the size that matters, or two at once | the name, or a set that contains it |
| an effect of a third or a tenth of that size | the same, or "none" |
| an effect that the library lacks | "unknown" |
| nothing but a soil that is told wrongly | "none" or "soil" |

"Part" means that one of two was named, "one more" that the right name came with another beside it.
Both are wrong.

"""


FIELD_HEADING = "## Conditions drawn at random\n"
FIELD = """
{measured}

**{done} of the {wanted} cases are done.** All are simulated; 400 of those wanted hide nothing.
Conditions are drawn for each case:

| condition | drawn from |
|---|---|
| rover | four; two have no model |
| soil | three presets |
| size of an effect | the range of the hidden law |
| soil as told | the right file; in a third of the cases another one, the right one at hand |
| noise | as stated; in a third of the cases 0.5 to 2 times that |
| rover file | right, and told as exact (`--rover-sd exact`) |

Two families do not count for the bars of all cases: ground between two presets, for which there is
no file, and cases in which nothing is hidden and all is told rightly.

The rule of the verdict was frozen by commit {frozen}, whose
first eight digits are the seed of these cases. Cases of earlier rules are in the history of this
page. All families advance in step, so that those done are a sample of all; those of nothing are
examined by themselves. "No drive" means that every observation of the analysed drives was
refused: the command says so and has no verdict. {examined}

"""


ROVER_HEADING = "## A rover that is not that of its file\n"
ROVER = """
{measured}

**{done} of the {wanted} cases are done.** Rover, soil and noise are drawn as above, and with
them the errors of the rover file: mass, wheel radius and place of the centre of mass, each with a
stated deviation of 0.5 to 2 % of the mass, 0.2 to 0.6 % of the radius, 0.4 to 1.4 % of the
wheelbase. The errors are Gaussian, cut off at 2.5 deviations. The search is told the deviations
(`--rover-sd`). In one family the mass or the radius is 3 to 5 deviations off: there `payload` or
`odometry_scale` is right if the 95 % interval of its size holds the true one. A payload or an
odometry_scale within 2.5 stated deviations may be "none" as well. The rule was frozen by commit
{frozen},
whose first eight digits are the seed of these cases. What is younger, with the cases of the field:
the rule of two effects, the law of `slip_sinkage` and the law that is hidden for it, and what was
frozen for the field. `--untold` searches the same cases as the command does where nobody states
deviations. {examined}

"""


def page(records: list[Record], wanted: int) -> str:
    """Return the page of the cases that are done under set conditions."""
    head = INTRODUCTION.format(measured=measured("hidden"), done=len(records), wanted=wanted)
    return f"{head}{bars(records)}\n{VERDICTS}{outcomes(records)}"


def field(records: list[Record], wanted: int, frozen: str) -> str:
    """Return the section of the cases that are done under drawn conditions."""
    line = measured("hidden", "--field")
    head = FIELD.format(
        measured=line, done=len(records), wanted=wanted, frozen=frozen, examined=_examined(records)
    )
    tables = [field_bars(records), conditions(records), outcomes(records)]
    return FIELD_HEADING + head + "\n".join(tables)


def rover(records: list[Record], wanted: int, frozen: str) -> str:
    """Return the section of the cases whose rover is not that of its file."""
    line = measured("hidden", "--field --rover")
    told = [each for each in records if UNTOLD not in each["family"]]
    head = ROVER.format(
        measured=line, done=len(told), wanted=wanted, frozen=frozen, examined=_examined(records)
    )
    tables = [rover_bars(told), told_and_untold(records)]
    tables += [constants_found(told), outcomes(records)]
    return ROVER_HEADING + head + "\n".join(tables)


def _examined(records: Sequence[Record]) -> str:
    counts = Counter(each.get("commit", "unknown") for each in records)
    listed = ", ".join(f"{count} at {commit}" for commit, count in counts.items())
    return f"Records: [tests/hidden/records](../tests/hidden/records). Examined: {listed}."


def joined(text: str, first: str | None, section: str | None, of_rover: str | None = None) -> str:
    """Return the page ``text`` with other parts; None: as it is.

    They are the ``first`` one, the ``section`` of the field, and that ``of_rover``.
    """
    rest, rover_there, rover_text = text.partition(ROVER_HEADING)
    before, field_there, field_text = rest.partition(FIELD_HEADING)
    kept = before, field_there + field_text, rover_there + rover_text
    given = first, section, of_rover
    parts = [old if new is None else new for old, new in zip(kept, given, strict=True)]
    return "\n\n".join(part.rstrip("\n") for part in parts if part) + "\n"
