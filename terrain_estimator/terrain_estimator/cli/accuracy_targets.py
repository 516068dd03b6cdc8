# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""What the estimator is meant to reach, and whether the figures of ``accuracy`` do."""

from collections.abc import Callable, Iterator

from terrain_estimator.learning.accuracy import ParameterScore, Share
from terrain_estimator.learning.study import TARGET_ROWS, Cell

MOST_OF_BOUND = 1.3
"""[1] Ratio of error to bound."""
_ERRORS = (
    ("paper_rover", False, 0.03, 0.04),
    ("mars_rover", False, 0.10, 0.04),
    ("paper_rover", True, 0.15, 0.08),
    ("mars_rover", True, 0.15, 0.08),
)
"""Rover, constants wrong, and the largest median error of c and of tan phi on loose sand after 40 s."""
_NAMES = ("c", "tan phi")


def verdicts(cells: list[Cell]) -> list[tuple[str, str, str, str]]:
    """What is meant, the target, what was found, and yes or no, for all targets that ``cells`` can tell."""
    hills = [c for c in cells if (c.schedule, c.truth, c.model) == ("S1", "prior", "physics") and c.rows in TARGET_ROWS]
    lines = [*_median_errors(hills)]
    lines += _worst("error / bound where identified, worst cell", f"at most {MOST_OF_BOUND}", hills, _ratio)
    exact, wrong = [c for c in hills if not c.spread], [c for c in hills if c.spread]
    lines += _coverages("coverage of the 95 % interval, exact constants", exact, (0.93, 0.97))
    lines += _coverages("coverage of the 95 % interval, constants 5 % wrong", wrong, (0.90, 0.98))
    lines += _worst("compact sand: share of episodes that call c identified", "0", [c for c in exact if c.soil == "compact_sand"], _claims)
    lines += _velocity(hills)
    return lines


def _scores(cell: Cell) -> tuple[tuple[str, ParameterScore], ...]:
    return tuple(zip(_NAMES, (cell.score.cohesion, cell.score.tan_phi), strict=True))


def _yes(met: bool) -> str:  # noqa: FBT001 (one flag, its name is the function's)
    return "yes" if met else "**no**"


def _name(cell: Cell) -> str:
    return f"{cell.rover}, {cell.soil}, {'5 % wrong' if cell.spread else 'exact'}, {cell.rows}"


def _median_errors(hills: list[Cell]) -> Iterator[tuple[str, str, str, str]]:
    for rover, wrong, cohesion, tan_phi in _ERRORS:
        for cell in hills:
            if (cell.rover, cell.soil, bool(cell.spread)) == (rover, "loose_sand", wrong):
                found = (cell.score.cohesion.median_error[-1], cell.score.tan_phi.median_error[-1])
                target = f"c {100 * cohesion:g} %, tan phi {100 * tan_phi:g} %"
                said = f"c {100 * found[0]:.1f} %, tan phi {100 * found[1]:.1f} %"
                yield f"median error, {_name(cell)}", target, said, _yes(found[0] <= cohesion and found[1] <= tan_phi)


def _worst(what: str, target: str, cells: list[Cell], judge: Callable[[Cell], tuple[float, bool, str]]) -> list[tuple[str, str, str, str]]:
    if not cells:
        return []
    value, met, where = max((judge(cell) for cell in cells), key=lambda found: found[0])
    return [(what, target, f"{value:.2f} ({where})", _yes(met))]


def _ratio(cell: Cell) -> tuple[float, bool, str]:
    known = [(name, p) for name, p in _scores(cell) if p.identified > 0.5]
    if not known:
        return 0.0, True, "nothing identified"
    name, worst = max(known, key=lambda pair: pair[1].ratio_to_bound[-1])
    ratio = worst.ratio_to_bound[-1]
    return ratio, ratio <= MOST_OF_BOUND, f"{name}, {_name(cell)}"


def _claims(cell: Cell) -> tuple[float, bool, str]:
    share = cell.score.cohesion.identified
    return share, share == 0.0, _name(cell)


def _coverages(what: str, cells: list[Cell], band: tuple[float, float]) -> list[tuple[str, str, str, str]]:
    shares = [(p.coverage_95, f"{name}, {_name(cell)}") for cell in cells for name, p in _scores(cell)]
    if not shares:
        return []
    missed = [where for share, where in shares if not _touches(share, band)]
    lowest, highest = min(s.share for s, _ in shares), max(s.share for s, _ in shares)
    found = f"{100 * lowest:.1f} to {100 * highest:.1f} %" + (f"; outside: {'; '.join(missed)}" if missed else "")
    return [(what, f"{100 * band[0]:g} to {100 * band[1]:g} %, missed only if the 99 % limits exclude it", found, _yes(not missed))]


def _touches(share: Share, band: tuple[float, float]) -> bool:
    return share.low <= band[1] and share.high >= band[0]


def _velocity(hills: list[Cell]) -> list[tuple[str, str, str, str]]:
    if not hills:
        return []
    covered = [cell.score.velocity_coverage_95 for cell in hills]
    ratio = [cell.score.velocity_calibration for cell in hills]
    met, near = min(covered) >= 0.93 and max(covered) <= 0.97, min(ratio) >= 0.8 and max(ratio) <= 1.2
    shares = f"{100 * min(covered):.1f} to {100 * max(covered):.1f} %"
    return [
        ("one-step velocity, coverage of the 95 % interval", "93 to 97 %", shares, _yes(met)),
        ("one-step velocity, predicted deviation / true one", "0.8 to 1.2", f"{min(ratio):.2f} to {max(ratio):.2f}", _yes(near)),
    ]
