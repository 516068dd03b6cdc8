# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The page of ``make names``."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import beta

from studies.false_names.drawn import FAMILIES, HIDDEN
from studies.false_names.judged import Judged
from studies.tables import licence, table
from terrain_estimator.discovery.single_wheel.families import NAME

INTRODUCTION = """# False names on tables of one wheel

{measured} Seed of the judged tables {seed}, of the calibration {calibration}.

How often does `find_missing_effect --wheel-table` name an effect where none is missing? Tables are
drawn as laboratories make them: six slips of 0 to 0.8 at one load or two, one carriage speed or
one wheel rate, a wheel alone or with a reference that does not differ from it, zeros known or free,
errors of reading. Soil constants are those that plates and a shear box give on the same soil, off
by 15 % more. **The soils obey other laws than the contact law's**: each of pressure (power,
exponential with a bound, hyperbola, crust), shear (Janosi, hyperbola, hump) and distribution along
the rim (shifted, by depth, half wave, with an exit angle) is drawn at random, by code of the
study's own. No effect is hidden, so any name counts as false, also one for the reference: even
exit_angle where the soil reaches behind the axle, as with the half wave and the exit angle. A
misfit of the law is rightly "none" or "unknown".

The rule was frozen by commit {frozen}; the seed of the judged tables is the first eight digits of
that commit, so nobody chose it. Laws were added to the library since
([effects.md](effects.md#competing-laws)), when the verdicts about these tables were known; rule,
threshold and tables stayed as they were.

"""
HIDES = """
## Tables that do lack something

The same laboratories, the tested wheel with lugs (shear at their tips; full passive pressure;
thrust by spacing), digging or a wedge of soil ahead, by the study's own laws, with a reference.
Right is the family. "Size" counts true changes of drawbar pull at slip 0.3 in the reported 95 %
interval, where the family is right.

"""


@dataclass(frozen=True, slots=True)
class FalseNames:
    """All results of one run."""

    measured: str  # date, commit and code, as :func:`docs.provenance.measured` writes them
    frozen: str  # commit of the rule
    seed: int
    calibration_seed: int
    calibration: list[Judged]
    nothing: list[Judged]
    hidden: list[Judged]


def limits(count: int, of: int) -> tuple[float, float]:
    """Return 95 % confidence limits of a share (Clopper and Pearson)."""
    low = float(beta.ppf(0.025, count, of - count + 1)) if count else 0.0
    high = float(beta.ppf(0.975, count + 1, of - count)) if count < of else 1.0
    return low, high


def page(run: FalseNames) -> str:
    """Return the whole page."""
    return "".join(
        [
            licence("names"),
            INTRODUCTION.format(
                measured=run.measured,
                seed=run.seed,
                calibration=run.calibration_seed,
                frozen=run.frozen,
            ),
            _false(run),
            _threshold(run),
            HIDES,
            _hidden(run.hidden),
        ]
    )


def _false(run: FalseNames) -> str:
    parts: list[tuple[str, Sequence[Judged]]] = [
        ("all", run.nothing),
        ("a wheel alone", [each for each in run.nothing if not each.reference]),
        ("with a reference", [each for each in run.nothing if each.reference]),
    ]
    lines = []
    for title, judged in parts:
        count = sum(each.names for each in judged)
        unknown = sum(each.verdict == "unknown" for each in judged)
        shown = _share(count, len(judged))
        lines.append((title, str(len(judged)), str(count), shown, str(unknown)))
    false = [each for each in run.nothing if each.names]
    listed = "".join(
        f"- table {each.number} ({each.laws}): {', '.join(each.named + each.reference_lacks)}\n"
        for each in false
    )
    head = ("tables", "number", "false names", "share (95 % limits)", "unknown")
    return table(head, lines) + (f"\nFalse names:\n\n{listed}" if listed else "")


def _threshold(run: FalseNames) -> str:
    gains = [each.gain for each in run.calibration]
    ends = ", ".join(f"{np.quantile(gains, share):.1f}" for share in (0.5, 0.95, 1.0))
    false = sum(each.names for each in run.calibration)
    return (
        "\n## Threshold\n\n"
        f"A name needs {NAME:g} nat over the model error. In {len(gains)} tables of the calibration"
        f" the best family gains {ends} nat (median, 95 % quantile, largest), and {false} have a"
        " false name.\n"
    )


def _hidden(hidden: Sequence[Judged]) -> str:
    lines = []
    for kind in (*HIDDEN, "all"):
        own = [each for each in hidden if kind in (each.hidden, "all")]
        said = Counter(_said(each) for each in own)
        right = [each for each in own if _said(each) == "right"]
        held = sum(_holds(each) for each in right)
        lines.append(
            (
                f"{kind} ({FAMILIES[kind]})" if kind in FAMILIES else kind,
                str(len(own)),
                _share(said["right"], len(own)),
                *(str(said[word]) for word in ("in a set", "no name", "wrong")),
                _share(held, len(right)),
            )
        )
    head = ("hidden", "tables", "right", "in a set", "no name", "wrong", "size")
    return table(head, lines)


def _said(each: Judged) -> str:
    if not each.named:
        return "no name"
    family = FAMILIES[each.hidden]
    if family not in each.named:
        return "wrong"
    return "right" if each.named == [family] else "in a set"


def _holds(each: Judged) -> bool:
    if each.size is None or each.true_size is None:
        return False
    return each.size[0] <= each.true_size <= each.size[2]


def _share(count: int, of: int) -> str:
    if not of:
        return "-"
    low, high = limits(count, of)
    return f"{count} of {of}: {count / of:.1%} ({low:.1%} to {high:.1%})"
