# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Laws that compete for a name, on tables whose effect the study's own wheel made."""

import numpy as np
import pytest
import torch

from studies.false_names.drawn import FAMILIES, draw
from terrain_estimator.discovery.hypotheses.library import NOTHING, Hypothesis, LibraryEffect
from terrain_estimator.discovery.single_wheel.cells import cells_of
from terrain_estimator.discovery.single_wheel.families import NAME
from terrain_estimator.discovery.single_wheel.fit import WheelModel, explain
from terrain_estimator.discovery.single_wheel.investigation import competing, loosened

SEED = 11
"""Of one laboratory for each effect; fixed before any of them was judged."""


@pytest.mark.parametrize(
    ("hidden", "laws"),
    [
        ("wedge", {"hegedus_wedge", "bekker_wedge"}),
        ("passive", {"lug_sides", "spaced_lugs"}),
        ("digging", {"sinkage_growth"}),
    ],
)
def test_each_new_law_earns_its_family_s_name_where_another_code_hid_the_effect(
    hidden: str, laws: set[str]
) -> None:
    drawn = draw(np.random.default_rng(SEED), hidden)
    bed, cells = loosened(drawn.bed), cells_of(drawn.rows, drawn.reference)
    every = competing(Hypothesis((LibraryEffect(FAMILIES[hidden]),)))
    new = [each for each in every if each.effects[0].law_name in laws]
    assert len(new) == len(laws)
    with torch.inference_mode():
        nothing = explain(WheelModel(bed, NOTHING, NOTHING), cells, flexible=True)
        for each in new:
            model = WheelModel(bed, NOTHING, each)
            start = np.concatenate([nothing.values, model.start()[len(nothing.values) :]])
            found = explain(model, cells, flexible=True, start=start)
            gain = found.log_evidence - nothing.log_evidence
            assert gain > NAME, each.effects[0].law_name
            assert found.values[model.first] > 0.0
