# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Bars for verdicts on hidden cases, and the figures reached, with confidence limits."""

import math
import statistics
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, bootstrap

from terrain_estimator.discovery.hypotheses.rover_doubt import NOTABLE
from terrain_estimator.intervals import HALF_WIDTH_95
from tests.hidden.judge.judging import NO_DRIVE, Record
from tests.hidden.judge.strata import (
    NO_FILE,
    NOTHING,
    ROVER_BEYOND,
    ROVER_NOTHING,
    ROVER_ONE,
    UNTOLD,
)

CONFIDENCE = 0.95
NAMES = ("exact", "set", "part", "wrong name")
ONE_MORE = "one more"
"""Column of the wrong names that are the right one and another beside it."""
OUTCOMES = ("exact", "set", "part", ONE_MORE, "wrong name", "unknown", "none", "soil", NO_DRIVE)
HARDER = ("payload", "grousers", "odometry_scale")
Chosen = Callable[[Record], bool]


@dataclass(frozen=True, slots=True)
class Share:
    """Bar on the share of some cases that satisfy a condition."""

    what: str
    among: Chosen
    holds: Chosen
    least: float = 0.0
    most: float = 1.0
    cases: int = 80  # with fewer nothing is decided

    def row(self, records: Iterable[Record]) -> tuple[str, str, str, str]:
        """Return quantity, bar, found and verdict."""
        results = [self.holds(each) for each in records if self.among(each)]
        wanted = f"at least {self.least:.0%}" if self.most == 1.0 else f"at most {self.most:.0%}"
        wanted = (
            wanted
            if self.least == 0.0 or self.most == 1.0
            else f"{self.least:.0%} to {self.most:.0%}"
        )
        if not results:
            return self.what, wanted, "no cases", "not measured"
        count = sum(results)
        share = count / len(results)
        met = _met(met=self.least <= share <= self.most, cases=len(results), wanted=self.cases)
        return self.what, wanted, proportion(count, len(results)), met


def _met(*, met: bool, cases: int, wanted: int = 80) -> str:
    if cases < wanted:
        return f"open: {wanted} cases are asked for"
    return "met" if met else "missed"


def proportion(count: int, total: int) -> str:
    """Format a share with its Clopper-Pearson limits."""
    limits = binomtest(count, total).proportion_ci(CONFIDENCE)
    return f"{count} of {total} = {count / total:.1%} ({limits.low:.1%} to {limits.high:.1%})"


def _family(*names: str) -> Chosen:
    return lambda each: each["family"] in names


def _matters(each: Record) -> bool:
    return each["family"] == "matters"


def _named(each: Record) -> bool:
    return each["outcome"] in NAMES


def _unknown(each: Record) -> bool:
    return each["outcome"] == "unknown"


def _right_name(each: Record) -> bool:
    return each["outcome"] in ("exact", "set")


def _covered(each: Record) -> bool:
    """Return whether the size in the units of the named law lies in its 95 % interval."""
    name, size, spread = each["sizes"][0]
    assert name == each["plan"]
    return abs(size - each["equivalents"][0]) <= 1.96 * spread


def _field(each: Record) -> bool:
    return each["family"].startswith("field")


FIELD_SHARES = (
    Share("field, all cases: right", _field, lambda each: each["right"], least=0.93, cases=500),
    Share(
        "field, something hidden: right",
        lambda each: _field(each) and each["plan"] != "none",
        lambda each: each["right"],
        least=0.9,
        cases=380,
    ),
    Share(
        "field, one effect: 95 % interval of the size holds that of the nearest named law",
        lambda each: each["family"] == "field, one effect" and each["outcome"] == "exact",
        _covered,
        least=0.9,
        most=0.98,
        cases=80,
    ),
    Share(f"{NOTHING}: anything named", _family(NOTHING), _named, most=0.02, cases=400),
    Share(f"{NOTHING}: unknown", _family(NOTHING), _unknown, most=0.05, cases=400),
)
SHARES = (
    Share(
        "nothing hidden, soil constants wrong by up to 5 %: anything named",
        _family("none"), _named, most=0.02, cases=400,
    ),
    Share("nothing hidden: unknown", _family("none"), _unknown, most=0.05, cases=200),
    Share("right name, or a confusable set with it", _matters, _right_name, least=0.95, cases=100),
    Share(
        "exact name, without " + ", ".join(HARDER),
        lambda each: _matters(each) and each["plan"] not in HARDER,
        lambda each: each["outcome"] == "exact",
        least=0.9,
        cases=80,
    ),
    Share(
        "exact name of " + ", ".join(HARDER),
        lambda each: _matters(each) and each["plan"] in HARDER,
        lambda each: each["outcome"] == "exact",
        least=0.8,
        cases=20,
    ),
    Share("outside the library: unknown", _family("outside"), _unknown, least=0.9, cases=30),
    Share(
        "outside the library: a name, which is wrong",
        _family("outside"), _named, most=0.05, cases=30,
    ),
    Share(
        "joint verdict right: nothing hidden, at the size that matters, outside the library",
        _family("none", "matters", "outside"),
        lambda each: each["right"],
        least=0.9,
        cases=300,
    ),
    Share(
        "95 % interval of the size holds that of the nearest named law",
        lambda each: _matters(each) and each["outcome"] == "exact",
        _covered, least=0.9, most=0.98, cases=80,
    ),
)  # fmt: skip


def gap_row(records: Sequence[Record]) -> tuple[str, str, str, str]:
    """Return the row of the median share of the held-out gap that a right name closes."""
    what, wanted = (
        "held-out gap closed on the way to the noise floor, when named, median",
        "at least 80%",
    )
    closed = [
        each["gap_closed"]
        for each in records
        if _matters(each) and _named(each) and each["gap_closed"] is not None
    ]
    if len(closed) < 2:
        return what, wanted, "no cases", "not measured"
    limits = bootstrap(
        (closed,),
        np.median,
        confidence_level=CONFIDENCE,
        rng=np.random.default_rng(0),
        method="percentile",
    )
    ends = limits.confidence_interval
    median = statistics.median(closed)
    return (
        what,
        wanted,
        f"{median:.0%} of {len(closed)} ({ends.low:.0%} to {ends.high:.0%})",
        _met(met=median >= 0.8, cases=len(closed)),
    )


def bias_rows(records: Sequence[Record]) -> list[tuple[str, str, str, str]]:
    """Return the rows of the rms of a case's mean error, with the finding over that without."""
    pairs = [each["strength"] for each in records if _matters(each) and _right_name(each)]
    rows = []
    for index, name in enumerate(("c", "tan phi")):
        what, wanted = f"bias of {name} after, relative to before", "at most 50%"
        if len(pairs) < 2:
            rows.append((what, wanted, "no cases", "not measured"))
            continue
        squares = np.array([[before[index] ** 2, after[index] ** 2] for before, after in pairs])
        ratio = float(np.sqrt(squares[:, 1].sum() / squares[:, 0].sum()))
        drawn = np.random.default_rng(0).integers(len(squares), size=(2000, len(squares)))
        sums = squares[drawn].sum(1)
        low, high = np.quantile(np.sqrt(sums[:, 1] / sums[:, 0]), [0.025, 0.975])
        rows.append(
            (
                what,
                wanted,
                f"{ratio:.0%} of {len(pairs)} ({low:.0%} to {high:.0%})",
                _met(met=ratio <= 0.5, cases=len(pairs)),
            )
        )
    return rows


def _points_at(each: Record) -> bool:
    """Return whether nothing is named and the constant that is beyond its deviation stands out."""
    moved, _ = each.get("moved", {}).get(each["plan"], (0.0, 0.0))
    right_way = moved * each["off"].get(each["plan"], 0.0) > 0.0
    return not _named(each) and abs(moved) >= NOTABLE and right_way


ROVER_SHARES = (
    Share(
        "nothing hidden, constants within their stated deviations: anything named",
        _family(ROVER_NOTHING), _named, most=0.05, cases=60,
    ),
    Share(
        "one effect, constants within their stated deviations: right",
        _family(ROVER_ONE), lambda each: each["right"], least=0.8, cases=80,
    ),
    Share(
        "mass or wheel radius beyond its stated deviation: its name with the true size",
        _family(ROVER_BEYOND), lambda each: each["right"], least=0.8, cases=40,
    ),
    Share(
        "beside the rule: the same, or the page points at the constant",
        _family(ROVER_BEYOND), lambda each: each["right"] or _points_at(each), least=0.8, cases=40,
    ),
    Share(
        "one effect, exact name: 95 % interval of the size holds that of the nearest named law",
        lambda each: each["family"] == ROVER_ONE and each["outcome"] == "exact",
        _covered, least=0.9, most=0.98, cases=60,
    ),
)  # fmt: skip


def rover_bars(records: Sequence[Record]) -> str:
    """Return the table of the bars where the rover is not that of its file, as Markdown."""
    return _bars([each.row(records) for each in ROVER_SHARES])


def told_and_untold(records: Sequence[Record]) -> str:
    """Return the table of cases that were searched with and without the stated deviations."""
    keys = {each["key"].replace(UNTOLD, "", 1): each for each in records if UNTOLD in each["key"]}
    pairs = [(each, keys[each["key"]]) for each in records if each["key"] in keys]
    columns = ("right, told", "right, untold", "a wrong name, told", "a wrong name, untold")
    lines = [f"| family | cases in both | {' | '.join(columns)} |", "|---|---|---|---|---|---|"]
    for family in dict.fromkeys(told["family"] for told, _ in pairs):
        both = [pair for pair in pairs if pair[0]["family"] == family]
        cells = [family, str(len(both))]
        sides = tuple(zip(*both, strict=True))  # told, untold
        for holds in (lambda each: each["right"], _wrongly_named):
            cells += [proportion(sum(map(holds, each)), len(both)) for each in sides]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def constants_found(records: Sequence[Record]) -> str:
    """Return the table of what the search says of the rover's constants, as Markdown.

    Of cases in which nothing is hidden and the constants are within their stated deviations.
    """
    errors: dict[str, list[tuple[float, float]]] = defaultdict(list)  # in stated deviations
    for each in records:
        if each["family"] == ROVER_NOTHING:
            for name, (moved, spread) in each.get("moved", {}).items():
                true = each["off"][name] / each["stated"][name]
                errors[name].append((true - moved, spread))
    lines = [
        "| constant, nothing hidden | error, rms [stated deviations] | 95 % interval holds it |",
        "|---|---|---|",
    ]
    for name, found in errors.items():
        rms = math.sqrt(sum(error**2 for error, _ in found) / len(found))
        held = sum(abs(error) <= HALF_WIDTH_95 * spread for error, spread in found)
        lines.append(f"| {name} | {rms:.2f} | {proportion(held, len(found))} |")
    return "\n".join(lines) + "\n"


def _wrongly_named(each: Record) -> bool:
    return _named(each) and not each["right"]


def bars(records: Sequence[Record]) -> str:
    """Return the table of the bars for conditions that are set, as Markdown."""
    rows = [each.row(records) for each in SHARES]
    rows[-1:-1] = [gap_row(records), *bias_rows(records)]
    return _bars(rows)


def field_bars(records: Sequence[Record]) -> str:
    """Return the table of the bars for conditions that are drawn, as Markdown."""
    return _bars([each.row(records) for each in FIELD_SHARES])


def _bars(rows: Sequence[tuple[str, str, str, str]]) -> str:
    lines = [
        "| what | bar | found (95 % limits) | |",
        "|---|---|---|---|",
        *("| " + " | ".join(row) + " |" for row in rows),
    ]
    return "\n".join(lines) + "\n"


def conditions(records: Sequence[Record]) -> str:
    """Return the table of right verdicts by condition of the field, as Markdown."""
    groups: dict[str, list[Record]] = defaultdict(list)
    for each in records:
        if each["family"] == NOTHING:
            groups[f"beside the bars: {NOTHING}, {each['rover']} on {each['soil']}"].append(each)
            continue
        if each["family"] == NO_FILE:
            groups["beside the bars: ground between two soil files, told one of them"].append(each)
            continue
        wrong, noisy = each["told"] != each["soil"], each["noise"] != 1.0
        groups[f"soil told {'wrongly' if wrong else 'rightly'}"].append(each)
        groups[f"noise {'misstated' if noisy else 'as stated'}"].append(each)
        groups[each["rover"]].append(each)
        groups[each["soil"]].append(each)
    lines = ["| condition | right (95 % limits) |", "|---|---|"]
    for name, group in sorted(groups.items()):
        lines.append(f"| {name} | {proportion(sum(each['right'] for each in group), len(group))} |")
    return "\n".join(lines) + "\n"


def outcomes(records: Sequence[Record]) -> str:
    """Return the table of verdicts by family and hidden effect, as Markdown."""
    grouped: dict[tuple[str, str], list[Record]] = defaultdict(list)
    for each in records:
        grouped[each["family"], each["plan"]].append(each)
        grouped[each["family"], "all"].append(each)
    lines = [
        f"| family | hidden | cases | {' | '.join(OUTCOMES)} | right (95 % limits) |",
        "|---|---|---|" + "---|" * (len(OUTCOMES) + 1),
    ]
    for family in dict.fromkeys(each["family"] for each in records):
        plans = sorted(plan for name, plan in grouped if name == family and plan != "all")
        for plan in [*plans, "all"] if len(plans) > 1 else plans:
            group = grouped[family, plan]
            counts = Counter(_column(each) for each in group)
            cells = [family, plan, str(len(group)), *(str(counts[name] or "") for name in OUTCOMES)]
            lines.append(
                "| "
                + " | ".join([*cells, proportion(sum(each["right"] for each in group), len(group))])
                + " |"
            )
    return "\n".join(lines) + "\n"


def _column(record: Record) -> str:
    """Return the column that a record counts in."""
    return ONE_MORE if _is_one_more(record) else record["outcome"]


def _is_one_more(record: Record) -> bool:
    """Return whether each name is the whole of what is hidden and another effect beside it."""
    hidden = set(record["plan"].split("+"))
    if record["outcome"] != "wrong name" or "named" not in record:
        return False
    names = [{part.split(" (")[0] for part in each.split(" + ")} for each in record["named"]]
    return all(hidden < each for each in names)
