# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The page of ``make measured``."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from studies.measured.study import WAYS, CaseResult, WheelResult
from studies.measured.worlds import World
from studies.tables import licence, table
from terrain_estimator.discovery.single_wheel.cells import ROWS, UNITS
from terrain_estimator.discovery.single_wheel.law_fits import Interval

INTRODUCTION = """# Measured wheels

{measured} Seed {seed}.

What does the contact law say of wheels that laboratories measured? These are all tables of
`bags/measured`, judged as `find_missing_effect --wheel-table` does
([single_wheel.md](single_wheel.md)). Nothing here is simulated but the last table. HIT is the
Harbin Institute of Technology (Ding et al. 2011), CMU Carnegie Mellon University (Pavlov and
Johnson). Lugs are what the library calls `grousers`.

**Not blind.** The tables were at hand when the method was written: the deviations of HIT's zeros,
the rule that a reference is searched first and the two fits were made with them. The lengths and
ranges of the model error, the deviations of the soil constants and the error of reading slips were
set before their first result and not changed after it.

What is stated of the laboratories:

| deviations | HIT | CMU |
|---|---|---|
| n, k, K, c1, c2 | 20, 20, 9, 50, 50 % | 20, 20, 50, 50, 50 % |
| sinkage, drawbar pull | 0.5 mm, 0.5 N | 0.65 mm, 0.35 N |
| lateral force, torque | -, 0.1 N m | 0.35 N, - |
| zeros of sinkage, drawbar pull, torque | 5 mm, 2 N, 0.3 N m | 5 mm, 0, - |
| slip, read from a figure | 0.006 (1 % of the axis) | 0 |

20 % stands where a constant was measured and its deviation is not given, 50 % where it is assumed;
HIT's K was measured as 9.7 to 13.1 mm.

"""
VERDICTS = """## Verdicts

"Described" says whether errors on held-out settings are those of a true law (probability above
0.001). Where it says no, the law is wrong beyond the errors of measurement, whatever is named.

"""
HELD_OUT = """## Errors on settings that were held out

Root mean square errors. Each setting is held out in turn.

- **before**: the contact law, with effects that the reference alone lacks.
- **after**: with the effect that is named, or that was named and withdrawn because
  held-out settings did not improve; "-" where there was none.
- **kernel**: the Bekker-Wong kernel, which is the contact law with the measured constants, c and
  tan phi, and no fit. For CMU those are mostly assumed.
- **Bekker**: Bekker's sinkage and resistance of a rigid wheel with Janosi's thrust, of the same
  constants.
- **polynomial**: one for each row in slip and slip angle, fitted to the other settings of the same
  table, with as many coefficients in all as the law has free numbers, but fewer than settings.

"""
SHARES = """The same as shares: median of the drawbar pull's error over its size, at slips from 0.1.

"""
WHEELS = """## Errors on wheels that were held out

Everything is fitted to the laboratory's other wheel alone. The lugs' own size is unknown until they
are measured, so there is no "after" for them. In "after" of the smooth wheel the lugs' part was
fitted to the lugs' table and then left out. **Where "after" exceeds "before", the named effect
made the prediction of the other wheel worse.**

"""
FREE = """## How well can the law fit?

Root mean square errors with all constants, zeros and effects free. They say how flexible the law
is, not how true.

"""
STRENGTH = """## c and tan phi against the shear box

Medians and 95 % intervals with the constants as measured and a model error beside the law; both
start from no more than 0 to 10 kPa and 0 to 1.5. CMU measured no torque, so it has none.

"""
COVERAGE = """## Do these intervals hold the truth?

Simulated tables of HIT's smooth rim at its six slips, c 0 to 3 kPa, tan phi 0.35 to 0.85, errors as
stated above. A law that is wrong as a whole shows whether the estimated model error suffices.

"""
_WORDS = {"none": "no effect identified", "unknown": "unknown, closest {}"}
_HEADS = {"bekker": "Bekker"}
_SCALES = {"m": (1e3, "mm")}


@dataclass(frozen=True, slots=True)
class MeasuredRun:
    """All results of one run of ``measured``."""

    measured: str  # date, commit and code, as :func:`docs.provenance.measured` writes them
    seed: int
    cases: list[CaseResult]
    wheels: list[WheelResult]
    worlds: list[World]


def page(run: MeasuredRun) -> str:
    """Return the whole page."""
    return "".join(
        [
            licence("measured"),
            INTRODUCTION.format(measured=run.measured, seed=run.seed),
            VERDICTS,
            table(
                ("tables", "settings", "verdict", "probability", "proven", "described"),
                map(_verdict, run.cases),
            ),
            "\n" + HELD_OUT,
            _errors([(each.title, each.rows) for each in run.cases]),
            "\n" + SHARES,
            _shares(run.cases),
            "\n" + WHEELS,
            _errors([(each.title, each.rows) for each in run.wheels]),
            "\n" + FREE,
            _free(run.cases),
            "\n" + STRENGTH,
            _strength(run.cases),
            "\n" + COVERAGE,
            _coverage(run.worlds),
        ]
    )


def _verdict(found: CaseResult) -> tuple[str, ...]:
    names = ", ".join(found.named)
    words = _WORDS.get(found.verdict, f"{found.verdict}: {{}}").format(names)
    if found.given:
        words += f" (besides {', '.join(found.given)})"
    wanted = found.verdict if found.verdict in _WORDS else found.named[0]
    proven = {None: "too few settings", True: "yes", False: "no"}[found.proven]
    if found.verdict in _WORDS:
        proven = "-"
    described = "yes" if found.described else "no"
    share = f"{found.probabilities[wanted]:.2f}"
    return found.title, str(found.settings), words, share, proven, described


def _errors(
    parts: Sequence[tuple[str, Mapping[str, Mapping[str, float | None]]]],
) -> str:
    lines = [
        (title, _named(row), *(_value(rows[way][row], row) for way in WAYS))
        for title, rows in parts
        for row in rows["before"]
    ]
    head = ("tables", "row", *(_HEADS.get(way, way) for way in WAYS))
    return table(head, lines)


def _shares(cases: Sequence[CaseResult]) -> str:
    lines = [(each.title, *(_percent(each.pull_shares[way]) for way in WAYS)) for each in cases]
    return table(("tables", *(_HEADS.get(way, way) for way in WAYS)), lines)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:.0f} %"


def _free(cases: Sequence[CaseResult]) -> str:
    lines = []
    for each in cases:
        free = each.fits.free
        errors = ", ".join(f"{_named(row)} {_value(rms, row)}" for row, rms in free.rms.items())
        effects = ", ".join(each.fits.effects) or "-"
        lines.append((each.title, effects, f"{free.unknowns} of {free.measurements}", errors))
    return table(("tables", "effects", "free numbers of values", "errors"), lines)


def _strength(cases: Sequence[CaseResult]) -> str:
    lines = []
    for each in cases:
        soil, box = each.fits.measured, each.shear_box
        if soil is None or box is None:
            continue
        errors = ", ".join(
            f"{_named(row)} {_value(ends[1], row)}" for row, ends in soil.model_error.items()
        )
        rejected = "; ".join(
            f"{wrong.name} {_short(1e3 * wrong.measured)} mm measured,"
            f" {_interval(wrong.fitted, 1e3)} mm fits"
            if wrong.name == "shear_modulus"
            else f"{wrong.name} {_short(wrong.measured)} measured, {_interval(wrong.fitted)} fits"
            for wrong in each.fits.rejected
        )
        lines += [
            (
                each.title,
                "c [kPa]",
                _interval(soil.cohesion_pa, 1e-3),
                _inside(soil.cohesion_pa, box[0], 1e-3),
                errors,
                rejected or "-",
            ),
            (
                each.title,
                "tan phi",
                _interval(soil.tan_phi),
                _inside(soil.tan_phi, box[1]),
                "",
                "",
            ),
        ]
    head = ("tables", "", "estimate", "shear box", "model error", "contradicted constants")
    return table(head, lines)


def _coverage(worlds: Sequence[World]) -> str:
    return table(
        ("world", "tables", "c held", "tan phi held", "width of c", "width of tan phi"),
        [
            (
                each.name,
                str(each.tables),
                str(each.cohesion_covered),
                str(each.tan_phi_covered),
                f"{1e-3 * each.cohesion_width_pa:.2f} kPa",
                f"{each.tan_phi_width:.2f}",
            )
            for each in worlds
        ],
    )


def _inside(ends: Interval, value: float, scale: float = 1.0) -> str:
    held = "held" if ends[0] <= value <= ends[2] else "not held"
    return f"{_short(scale * value)}, {held}"


def _interval(ends: Interval, scale: float = 1.0) -> str:
    low, middle, high = (_short(scale * each) for each in ends)
    return f"{middle} ({low} to {high})"


def _named(row: str) -> str:
    return row.replace("_", " ")


def _value(value: float | None, row: str) -> str:
    if value is None:
        return "-"
    unit = dict(zip(ROWS, UNITS, strict=True))[row]
    scale, shown = _SCALES.get(unit, (1.0, unit))
    return f"{_short(scale * value)} {shown}"


def _short(value: float) -> str:
    return f"{value:.2g}" if abs(value) < 10.0 else f"{value:.3g}"
