# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The content of finding.json about one wheel, where two effects are named together."""

import dataclasses
import math
from pathlib import Path

import pytest
import torch

from terrain_estimator.discovery.evidence.verdict import Judgement, Verdict
from terrain_estimator.discovery.hypotheses.library import (
    NOTHING,
    Hypothesis,
    LibraryEffect,
    together,
)
from terrain_estimator.discovery.single_wheel.cells import Row, cells_of
from terrain_estimator.discovery.single_wheel.families import Family, Weighed
from terrain_estimator.discovery.single_wheel.fit import WheelModel, explain
from terrain_estimator.discovery.single_wheel.investigation import WheelFinding, held_out
from terrain_estimator.discovery.single_wheel.law_fits import ConstantsFree, LawFits
from terrain_estimator.offline.wheel_finding_content import wheel_content
from terramechanics.effects import describe
from tests.terrain_estimator.testbeds import RIG

ROWS = [Row("measured", "1", slip, 60.0, 0.5, 0.01, 5.0) for slip in (0.05, 0.2, 0.35, 0.5, 0.65)]
NO_FITS = LawFits((), ConstantsFree({}, 0, 0), None, ())


@pytest.mark.parametrize("competing", [None, 0])
def test_a_pair_has_the_units_and_names_of_the_laws_that_were_fitted(competing: int | None) -> None:
    """The registry's bulldozing is in N/m², that of a wedge in its share of a blade's pressure."""
    pair = together(
        Hypothesis((LibraryEffect("bulldozing", competing=competing),)),
        Hypothesis((LibraryEffect("slip_sinkage"),)),
    )
    cells, model = cells_of(ROWS), WheelModel(RIG, NOTHING, pair)
    values = model.start()
    values[model.first :] = 0.5
    measured = torch.from_numpy(model.of(cells, values))
    measured[:, 2:] = math.nan
    found = explain(model, dataclasses.replace(cells, measured=measured))
    nothing = explain(WheelModel(RIG, NOTHING, NOTHING), cells)
    outcome = WheelFinding(
        Judgement(Verdict.NAMED, (pair,), {pair.label: 1.0}),
        Weighed(nothing.log_evidence, nothing.log_evidence, (Family((found,)),)),
        RIG,
        nothing,
        held_out(RIG, ROWS, frozenset(), [NOTHING, NOTHING], by_trial=False),
        None,
        "",
        found.left,
    )
    first, second = wheel_content(
        outcome, NO_FITS, RIG, ROWS, frozenset(), NOTHING, [Path("t.csv")], by_trial=False, seed=0
    )["effects"]
    bulldozing = describe("bulldozing")
    law = bulldozing if competing is None else bulldozing.competing[competing]
    assert (first["unit"], second["unit"]) == (law.unit, describe("slip_sinkage").unit)
    named = bulldozing.coefficient if competing is None else bulldozing.competing[competing].name
    assert first["laws"] == [
        {"law": f"{named} + {describe('slip_sinkage').coefficient}", "weight": 1.0}
    ]
    size = pair.sizes((values[model.first :] * pair.shared().sd.numpy()).tolist(), [0.0] * 9)[0][1]
    assert first["coefficient"] == pytest.approx(size, rel=0.1)
