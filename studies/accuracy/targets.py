# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Targets of the estimator, and verdicts on the figures of the accuracy study."""

from collections.abc import Callable, Iterator, Sequence

from studies.accuracy.cells import TARGET_ROWS
from studies.accuracy.lines import Claim, TableLine
from studies.accuracy.scores import ParameterScore
from studies.limited import Limited

MOST_OF_BOUND = 1.15
"""[1] Ratio of error to bound."""
_ERRORS = (
    ("paper_rover", False, 0.03, 0.04),
    ("mars_rover", False, 0.10, 0.04),
    ("paper_rover", True, 0.15, 0.08),
    ("mars_rover", True, 0.15, 0.08),
)
"""Rover, constants wrong, largest median error of c and of tan phi on loose sand after 40 s."""
_NAMES = ("c", "tan phi")
_BANDS_95 = (("exact constants", False, (0.93, 0.97)), ("constants 5 % wrong", True, (0.93, 0.97)))
_BANDS_68 = (("exact constants", False, (0.64, 0.72)), ("constants 5 % wrong", True, (0.64, 0.72)))
"""Name of the cells, constants wrong, and the range of their coverage."""

Verdict = tuple[str, str, str, str]
"""Quantity, target, found, and yes or no."""


def over_hills(lines: Sequence[TableLine], model: str) -> list[TableLine]:
    """Return a model's lines with targets: drives of 40 s over hills, truth from the prior."""
    return [
        line for line in lines if (line.schedule, line.truth, line.model) == ("S1", "prior", model)
    ]


def verdicts(lines: Sequence[TableLine], model: str) -> list[Verdict]:
    """Return all verdicts on a model that follow from ``lines``."""
    every = over_hills(lines, model)
    meant = [line for line in every if line.rows in TARGET_ROWS]
    fewer = [line for line in every if line.rows not in TARGET_ROWS]
    compact = [line for line in meant if line.soil == "compact_sand"]
    found = [*_median_errors(meant)]
    found += _worst(
        "error / bound where identified, worst cell", f"at most {MOST_OF_BOUND}", meant, _ratio
    )
    for rows, chosen in (("", meant), (", v and v+L", fewer)):
        found += _of_both(f"coverage of the 95 % interval{rows}", chosen, _BANDS_95, _shares_95)
    found += _of_both(
        "the same, drives with status identified, every row set",
        every,
        _BANDS_95,
        _shares_identified,
    )
    for rows, chosen in (("", meant), (", v and v+L", fewer)):
        found += _of_both(f"coverage of the 68 % interval{rows}", chosen, _BANDS_68, _shares_68)
    found += _worst(
        "compact sand: share of drives with status identified for c", "0", compact, _claims
    )
    found += _narrowest("compact sand: least deviation of c / bound of any drive", compact)
    found += _worst(
        "identified, though not by the bound of the drive: share of drives",
        "0",
        meant,
        _unfounded,
    )
    found += _worst("the same, v and v+L", "0", fewer, _unfounded)
    return [*found, *_velocity(meant)]


def _parameters(line: TableLine) -> Iterator[tuple[str, ParameterScore, Claim]]:
    yield from zip(
        _NAMES,
        (line.score.cohesion, line.score.tan_phi),
        (line.cohesion, line.tan_phi),
        strict=True,
    )


def _yes(met: bool) -> str:  # noqa: FBT001 (one flag, its name is the function's)
    return "yes" if met else "**no**"


def _name(line: TableLine) -> str:
    return f"{line.rover}, {line.soil}, {'5 % wrong' if line.spread else 'exact'}, {line.rows}"


def _median_errors(lines: list[TableLine]) -> Iterator[Verdict]:
    for rover, wrong, cohesion, tan_phi in _ERRORS:
        for line in lines:
            if (line.rover, line.soil, bool(line.spread)) == (rover, "loose_sand", wrong):
                found = (line.score.cohesion.median_error[-1], line.score.tan_phi.median_error[-1])
                target = f"c {100 * cohesion:g} %, tan phi {100 * tan_phi:g} %"
                said = f"c {100 * found[0]:.1f} %, tan phi {100 * found[1]:.1f} %"
                yield (
                    f"median error, {_name(line)}",
                    target,
                    said,
                    _yes(found[0] <= cohesion and found[1] <= tan_phi),
                )


def _worst(
    what: str,
    target: str,
    lines: list[TableLine],
    judge: Callable[[TableLine], tuple[float, bool, str]],
) -> list[Verdict]:
    if not lines:
        return []
    value, met, where = max((judge(line) for line in lines), key=lambda found: found[0])
    return [(what, target, f"{value:.2f} ({where})", _yes(met))]


def _ratio(line: TableLine) -> tuple[float, bool, str]:
    known = [(p.ratio_to_bound[-1], name) for name, p, _ in _parameters(line) if p.identified > 0.5]
    if not known:
        return 0.0, True, "nothing identified"
    ratio, name = max(known)
    return ratio, ratio <= MOST_OF_BOUND, f"{name}, {_name(line)}"


def _claims(line: TableLine) -> tuple[float, bool, str]:
    share = line.score.cohesion.identified
    return share, share == 0.0, _name(line)


def _unfounded(line: TableLine) -> tuple[float, bool, str]:
    share, name = max((claim.unfounded, name) for name, _, claim in _parameters(line))
    return share, share == 0.0, f"{name}, {_name(line)}"


def _narrowest(what: str, lines: list[TableLine]) -> list[Verdict]:
    if not lines:
        return []
    least, where = min((line.cohesion.least, _name(line)) for line in lines)
    usual = min(line.score.cohesion.narrowest for line in lines)
    return [
        (
            what,
            "at least 1",
            f"{least:.2f} ({where}); 1 % quantile in the worst cell {usual:.2f}",
            _yes(least >= 1.0),
        )
    ]


def _shares_95(line: TableLine) -> Iterator[tuple[str, Limited]]:
    return ((name, parameter.coverage_95) for name, parameter, _ in _parameters(line))


def _shares_68(line: TableLine) -> Iterator[tuple[str, Limited]]:
    return ((name, parameter.coverage_68) for name, parameter, _ in _parameters(line))


def _shares_identified(line: TableLine) -> Iterator[tuple[str, Limited]]:
    return ((name, claim.covered) for name, _, claim in _parameters(line) if claim.covered)


def _of_both(
    what: str,
    lines: list[TableLine],
    bands: Sequence[tuple[str, bool, tuple[float, float]]],
    shares_of: Callable[[TableLine], Iterator[tuple[str, Limited]]],
) -> Iterator[Verdict]:
    """Judge the coverage of the cells with exact constants, and of those with wrong ones."""
    for constants, wrong, band in bands:
        shares = [
            (s, f"{name}, {_name(line)}")
            for line in lines
            if bool(line.spread) == wrong
            for name, s in shares_of(line)
        ]
        if not shares:
            continue
        missed = [
            f"{where}: {100 * share.value:.1f}"
            for share, where in shares
            if not _touches(share, band)
        ]
        lowest, highest = min(s.value for s, _ in shares), max(s.value for s, _ in shares)
        found = f"{100 * lowest:.1f} to {100 * highest:.1f} %"
        found += f"; {len(missed)} of {len(shares)} outside: {'; '.join(missed)}" if missed else ""
        target = (
            f"{100 * band[0]:g} to {100 * band[1]:g} %, missed only if the 99 % limits exclude it"
        )
        yield f"{what}, {constants}", target, found, _yes(not missed)


def _touches(share: Limited, band: tuple[float, float]) -> bool:
    return share.low <= band[1] and share.high >= band[0]


def _velocity(lines: list[TableLine]) -> Iterator[Verdict]:
    if not lines:
        return
    covered = [line.score.velocity_coverage_95 for line in lines]
    yield (
        "velocity filter, coverage of the 95 % interval",
        "93 to 97 %",
        *_within(covered, 0.93, 0.97, 100.0, " %"),
    )
    ratio = [line.score.velocity_calibration for line in lines]
    yield (
        "velocity filter, rms predicted deviation / rms innovation",
        "0.8 to 1.2",
        *_within(ratio, 0.8, 1.2),
    )
    for rover in dict.fromkeys(line.rover for line in lines):
        spread = [line.score.velocity_spread for line in lines if line.rover == rover]
        yield (
            f"velocity filter, predicted deviation / noise of the sensor, {rover}",
            "0.8 to 1.2",
            *_within(spread, 0.8, 1.2),
        )


def _within(
    values: list[float], low: float, high: float, unit: float = 1.0, name: str = ""
) -> tuple[str, str]:
    digits = 1 if name else 2
    said = f"{unit * min(values):.{digits}f} to {unit * max(values):.{digits}f}{name}"
    return said, _yes(low <= min(values) and max(values) <= high)
