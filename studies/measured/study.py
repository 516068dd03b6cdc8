# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The finding about each case, and errors on rows and wheels that were held out."""

from dataclasses import dataclass, replace

import numpy as np
import torch

from studies.measured.cases import Case
from studies.measured.references import bekker, kernel, left_out_polynomial, polynomial
from terrain_estimator.discovery.evidence.verdict import Verdict
from terrain_estimator.discovery.hypotheses.library import NOTHING, Hypothesis, together
from terrain_estimator.discovery.single_wheel.cells import ROWS, Cells, Rig, cells_of
from terrain_estimator.discovery.single_wheel.fit import WheelModel, explain
from terrain_estimator.discovery.single_wheel.investigation import (
    investigate_wheel,
    lacking_in_reference,
    of_one_wheel,
    shown_by_one_wheel,
)
from terrain_estimator.discovery.single_wheel.law_fits import LawFits, law_fits
from terrain_estimator.observation import Floats

WAYS = ("before", "after", "kernel", "bekker", "polynomial")
SIDEWAYS = "lateral_bulldozing"
DRIVING = 0.1
"""[1] Slip from which a drawbar pull is large enough for a relative error."""

Errors = dict[str, dict[str, float | None]]
"""Root mean square errors in SI units, by way and row; None where there is no prediction."""


@dataclass(frozen=True, slots=True)
class CaseResult:
    """What the tables of one case say."""

    title: str
    settings: int
    verdict: str
    named: list[str]  # effects
    given: list[str]  # effects that the reference lacks, which act in all tables
    proven: bool | None
    described: bool
    probabilities: dict[str, float]
    rows: Errors  # on settings that were held out
    pull_shares: dict[str, float | None]  # by way, see pull_share
    fits: LawFits
    shear_box: tuple[float, float] | None


@dataclass(frozen=True, slots=True)
class WheelResult:
    """Errors on a whole wheel, of which no row was fitted."""

    title: str
    rows: Errors


def study(case: Case, seed: int) -> CaseResult:
    """Return what find_missing_effect finds, and what references do on the same rows."""
    bed, rows, references = case.laboratory.bed(), case.rows, case.references
    cells = cells_of(rows, references)
    turned = any(row.slip_angle for row in rows)
    names = [each for each in shown_by_one_wheel() if turned or each != SIDEWAYS]
    with torch.inference_mode():
        given = lacking_in_reference(bed, rows, references, NOTHING, names, _silent, seed)
        names = [each for each in names if each not in given.names]
        finding = investigate_wheel(
            bed, rows, references, given, names, _silent, by_trial=False, seed=seed
        )
        fits = law_fits(bed, cells, given, finding.added, _silent, seed)
    own = cells.part([k for k in range(len(cells.slip)) if bool(cells.acts[k])])
    terms = fits.free.unknowns // len(fits.free.rms)
    held_out = finding.held_out
    errors = {
        "before": held_out.before,
        "after": held_out.after,
        "kernel": own.measured.numpy() - kernel(own, bed),
        "bekker": own.measured.numpy() - _bekker(own, bed),
        "polynomial": own.measured.numpy() - left_out_polynomial(cells, terms),
    }
    judgement = finding.judgement
    return CaseResult(
        case.title,
        len(own.slip),
        str(judgement.verdict),
        [name for each in judgement.named for name in each.names],
        list(given.names),
        finding.proven,
        held_out.described,
        judgement.probabilities,
        _by_row(errors, own),
        {way: pull_share(each, own) for way, each in errors.items()},
        fits,
        case.laboratory.shear_box,
    )


def held_out_wheels(case: Case, found: CaseResult) -> list[WheelResult]:
    """Predict each wheel of a case with a reference from the other one alone.

    ``found`` has the effect that tells them apart. Its size is unknown where the wheel with it is
    held out, so there is no prediction with it.
    """
    bed, cells = case.laboratory.bed(), cells_of(case.rows, case.references)
    given = _together(found.given)
    named = found.verdict in (Verdict.NAMED, Verdict.CONFUSABLE)
    both = (NOTHING, _together(found.named[:1])) if named else (NOTHING,)
    acting, smooth = (
        cells.part([k for k in range(len(cells.slip)) if bool(cells.acts[k]) is acts])
        for acts in (True, False)
    )
    terms = found.fits.free.unknowns // len(found.fits.free.rms)
    name = case.laboratory.name.upper()
    results = []
    with torch.inference_mode():
        for title, fitted, wanted, hypotheses in (
            (f"{name}, {case.reference}", acting, smooth, both),
            (f"{name}, {case.table}", smooth, acting, (NOTHING,)),
        ):
            measured = wanted.measured.numpy()
            bare = replace(wanted, acts=torch.zeros_like(wanted.acts))
            models = [WheelModel(bed, given, each) for each in hypotheses]
            missed = [measured - model.of(bare, explain(model, fitted).values) for model in models]
            errors = {
                "before": missed[0],
                "after": missed[1] if len(missed) > 1 else None,
                "kernel": measured - kernel(wanted, bed),
                "bekker": measured - _bekker(wanted, bed),
                "polynomial": measured - polynomial(fitted, wanted, terms),
            }
            results.append(WheelResult(title, _by_row(errors, wanted)))
    return results


def _together(names: list[str]) -> Hypothesis:
    found = NOTHING
    for each in of_one_wheel(names):
        found = together(found, each)
    return found


def _bekker(cells: Cells, bed: Rig) -> Floats:
    return bekker(cells, bed.soil, bed.rover.wheel_radius, bed.rover.wheel_width)


def _by_row(errors: dict[str, Floats | None], cells: Cells) -> Errors:
    seen = cells.seen.any(0).tolist()
    kinds = [k for k, any_seen in enumerate(seen) if any_seen]
    return {
        way: {ROWS[k]: None if each is None else _rms(each[:, k]) for k in kinds}
        for way, each in errors.items()
    }


def _rms(errors: Floats) -> float | None:
    known = errors[np.isfinite(errors)]
    return float(np.sqrt((known**2).mean())) if known.size else None


def pull_share(errors: Floats | None, cells: Cells) -> float | None:
    """Return the median of the drawbar pull's error over its size, slips from DRIVING; or None."""
    if errors is None:
        return None
    row = ROWS.index("drawbar_pull")
    measured = cells.measured[:, row].numpy()
    share = np.abs(errors[:, row] / measured)[cells.slip.numpy() >= DRIVING]
    known = share[np.isfinite(share)]
    return float(np.median(known)) if known.size else None


def _silent(share: float, note: str) -> None:
    del share, note
