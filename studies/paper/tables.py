# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The results of the paper's experiments as Markdown tables."""

from studies.paper.experiment import CellResult
from studies.paper.published import ESTIMATES, TRADE_OFF
from studies.paper.random_inputs import SeedScores, mean_and_error
from studies.paper.scores import Scores


def tables(results: list[CellResult]) -> str:
    """Return all tables of a run."""
    parts = []
    for result in results:
        title = f"{result.cell.plant.value} plant, {result.cell.soil.replace('_', ' ')}"
        parts += [f"### {title}: soil constants wrong by up to 5 %", _test_table(result), ""]
        parts += [
            f"### {title}: the authors' band, soil constants exact",
            _narrow_table(result),
            "",
        ]
    for result in results:
        if result.cell.soil == "loose_sand":
            parts += [
                f"### Trade-off, {result.cell.plant.value} plant, loose sand",
                _trade_off(result),
                "",
            ]
    return "\n".join(parts)


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _last(scores: Scores, name: str) -> str:
    """Format median and quartiles at the last time."""
    values = scores.get(name)
    if isinstance(values, dict):
        values = list(values.values())[-1]
    return _spread(values) if isinstance(values, list) else "-"


def _spread(values: list[float]) -> str:
    low, middle, high = values
    return f"{middle:.3g} ({low:.3g} to {high:.3g})"


def _shares(scores: Scores) -> str:
    shares = scores.get("coverage")
    return " / ".join(f"{100 * share:.0f}" for share in shares) if isinstance(shares, list) else "-"


def _number(scores: Scores, name: str, factor: float = 1.0) -> str:
    value = scores.get(name)
    return f"{factor * value:.3g}" if isinstance(value, float) else "-"


def _test_table(result: CellResult) -> str:
    published = ESTIMATES[result.cell.soil]
    head = [
        "method",
        "c %",
        "phi %",
        "paper, c / phi",
        "covered %, c / tan phi",
        "velocity mm/s",
        "velocity %",
        "covered %",
    ]
    rows = []
    for name, scores in result.testing.items():
        paper = published.get(name)
        rows.append([
            name,
            _last(scores, "cohesion_error_percent"),
            _last(scores, "angle_error_percent"),
            f"{paper[0]} / {paper[1]}" if paper else "",
            _shares(scores),
            _last(scores, "velocity_rms_mm_s"),
            _last(scores, "velocity_error_percent"),
            _number(scores, "velocity_coverage", 100.0),
        ])  # fmt: skip
    return _table(head, rows)


def _narrow_table(result: CellResult) -> str:
    head = ["method", "c %, mean", "tan phi %, mean", "c %", "tan phi %", "covered %, c / tan phi"]
    rows = [
        [
            name,
            _number(scores, "cohesion_mean_error_percent"),
            _number(scores, "tan_phi_mean_error_percent"),
            _last(scores, "cohesion_error_percent"),
            _last(scores, "tan_phi_error_percent"),
            _shares(scores),
        ]
        for name, scores in result.narrow.items()
        if "cohesion_error_percent" in scores
    ]
    return _table(head, rows)


def _trade_off(result: CellResult) -> str:
    head = [
        "model",
        "velocity %",
        "velocity mm/s",
        "parameters %",
        "parameters %, as in the figure",
        "paper: velocity / parameters",
    ]
    rows = []
    for name, (velocity, parameters) in TRADE_OFF.items():
        scores = result.testing[name]
        rows.append([
            name,
            _last(scores, "velocity_error_percent"),
            _last(scores, "velocity_rms_mm_s"),
            _last(scores, "error_percent"),
            _last(scores, "error_as_in_the_figure_percent"),
            f"{velocity:g} / {parameters:g}",
        ])  # fmt: skip
    return _table(head, rows)


def random_inputs_tables(results: list[SeedScores]) -> str:
    """Return a table for each soil: means over seeds, with standard errors."""
    parts = []
    for soil in dict.fromkeys(each.soil for each in results):
        own = [each.methods for each in results if each.soil == soil]
        title = f"### Trained on random inputs, closed form plant, {soil.replace('_', ' ')}"
        parts += [f"{title}, {len(own)} seeds", _random_inputs_table(own), ""]
    return "\n".join(parts)


def _random_inputs_table(seeds: list[dict[str, Scores]]) -> str:
    head = ["method", "c %, mean", "tan phi %, mean", "covered %, c / tan phi"]
    rows = []
    for name in seeds[0]:
        cells = [
            "{:.3g} +- {:.2g}".format(
                *mean_and_error(
                    [_real(each[name], f"{quantity}_mean_error_percent") for each in seeds]
                )
            )
            for quantity in ("cohesion", "tan_phi")
        ]
        shares = [each[name].get("coverage") for each in seeds]
        known = [share for share in shares if isinstance(share, list)]
        covered = (
            [mean_and_error([100.0 * share[k] for share in known])[0] for k in range(2)]
            if known
            else []
        )
        rows.append([name, *cells, " / ".join(f"{share:.0f}" for share in covered) or "-"])
    return _table(head, rows)


def _real(scores: Scores, name: str) -> float:
    value = scores[name]
    if not isinstance(value, float):
        raise TypeError(f"{name}: {value!r} is not a number")
    return value
