# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soil probabilities and their mixture against a posterior over the whole drive on each soil.

The reference knows no change of the ground. The weight of hypotheses started anew on the way is
bounded, so that both mean the same.
"""

from typing import NamedTuple
from unittest.mock import patch

import torch
from torch import Tensor

from studies.accuracy.scores import row_mask
from terrain_estimator.learning.restore import restore
from terrain_estimator.learning.tasks import CONSTANTS_SPREAD, draw_tasks
from terrain_estimator.learning.training import build_model
from terrain_estimator.model.gaussian import mixture
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics import SoilRows
from terrain_estimator.model.state import State
from terramechanics.presets import load_rover, load_soil
from terramechanics.terrain.soil import Soil
from tests.studies.whole_drive import WholeDrive, in_one_chain

BLOCKS = 10


class Compared(NamedTuple):
    """The recursion beside the reference after one drive."""

    # [L, 2] log probability of each remaining soil: the recursion's, the reference's
    log_probability: Tensor
    shift: Tensor  # [2] of the published mean of (c, tan phi), in deviations of the reference
    ratio: Tensor  # [2] of the published deviation to the reference's


class Seen(NamedTuple):
    """The recursion's last state, and where each block's rows were taken on each soil."""

    state: State
    expanded: Tensor  # [B, K, 2 + M]


def seen(model: PAlpaca, packed: Tensor) -> Seen:
    """Run the model over one drive."""
    expanded: list[Tensor] = []
    state, average = model.initial(), model.physics.average

    def recorded(
        packed: Tensor, learnt: Tensor, soil: int, expansion: Tensor, chosen: Tensor
    ) -> SoilRows:
        """Keep the last place at which a block's rows are evaluated on a soil."""
        expanded[-1][soil] = expansion
        return average(packed, learnt, soil, expansion, chosen)

    with patch.object(model.physics, "average", recorded):
        for first in range(0, packed.shape[0], model.block_size):
            expanded.append(state["expansion"].clone())
            for observation in packed[first : first + model.block_size]:
                state = model.update(state, observation)
    assert float((state["weight"] * (state["age"] < len(expanded))).sum()) < 0.01, (
        "hypotheses started anew on the way"
    )
    return Seen(state, torch.stack(expanded))


def compared(model: PAlpaca, packed: Tensor, found: Seen, *, shared: bool) -> Compared:
    """``shared``: the reference takes its rows where the recursion took them."""
    state = found.state
    mean, covariance = state["strength_mean"], state["strength_covariance"]
    left = torch.nonzero(state["soils"] > 0.0).squeeze(1).tolist()
    beliefs = [
        WholeDrive(model, packed, soil=soil).belief(
            state["expansion"][soil], covariance, found.expanded[:, soil] if shared else None
        )
        for soil in left
    ]
    evidence, means, covariances = (torch.stack(field) for field in zip(*beliefs, strict=True))
    centre, spread = mixture(evidence, means, covariances)
    deviation = spread.diagonal().sqrt()
    log_probability = torch.stack([state["soils"][left].log(), torch.log_softmax(evidence, 0)], 1)
    return Compared(
        log_probability, (mean - centre) / deviation, covariance.diagonal().sqrt() / deviation
    )


def alike() -> PAlpaca:
    """Return a model of three soils that a drive does not separate at once.

    Two differ from the first by 10 % in stiffness or shear modulus.
    """
    loose = load_soil("loose_sand")
    stiffer = loose.with_values(k_c=1.1 * loose.k_c, k_phi=1.1 * loose.k_phi)
    model = build_model(
        load_rover("mars_rover"),
        [loose, stiffer, loose.with_values(shear_modulus=1.1 * loose.shear_modulus)],
    )
    return model.requires_grad_(requires_grad=False)


def drives(model: PAlpaca, soil: Soil, count: int) -> Tensor:
    """Return drives [N, 10 B, P] with linked velocities and constants within 5 % of ``soil``'s."""
    generator = torch.Generator().manual_seed(31)
    packed = draw_tasks(
        load_rover("mars_rover"), soil, "S1", float(BLOCKS), count, generator, CONSTANTS_SPREAD
    ).measured
    chained = in_one_chain(model, packed)
    assert bool(chained.any())
    return packed[chained]


def test_soils_that_are_alike_have_the_probabilities_of_their_evidence() -> None:
    """3 drives of 10 s, every row; all three soils stay.

    Given the recursion's rows: log odds within half a nat, means within a quarter of a deviation,
    deviations within 10 %. With rows at the reference's own place its odds are farther away, as the
    recursion never returns to rows of earlier blocks: asserted are two nat, means within half a
    deviation, deviations within 10 %. Before a block's rows were evaluated anew where it moves the
    constants, odds were up to 3.2 nat away (4 other drives).
    """
    model = alike()
    for packed in drives(model, load_soil("loose_sand"), 3):
        found = seen(model, packed)
        same, own = (compared(model, packed, found, shared=shared) for shared in (True, False))
        assert same.log_probability.shape[0] == 3
        check(same, 0.5, 0.25, 0.1)
        check(own, 2.0, 0.5, 0.1)


def test_the_shipped_soils_have_the_probabilities_of_their_evidence() -> None:
    """2 drives of 10 s on each soil, of velocity and load rows alone.

    All rows separate the soils in two seconds. Dropped soils are left out. Given its rows the
    bounds are those of soils that are alike, also given the reference's own. Odds were up to 9 nat
    away while rows were evaluated once: a wrong soil has to move its constants far.
    """
    loaded = load_model()
    model = restore(loaded)
    model.every_row.copy_(row_mask("v+L", model.axles))
    several = 0
    for soil in loaded.metadata.soils:
        for packed in drives(model, soil, 2):
            found = seen(model, packed)
            same, own = (compared(model, packed, found, shared=shared) for shared in (True, False))
            several += int(same.log_probability.shape[0] > 1)
            check(same, 0.5, 0.25, 0.1)
            check(own, 2.0, 0.5, 0.1)
    assert several >= 1


def check(found: Compared, odds: float, shift: float, ratio: float) -> None:
    """Check the largest differences of log odds [nat], of means and of deviations."""
    difference = found.log_probability[:, 0] - found.log_probability[:, 1]
    assert float(difference.max() - difference.min()) <= odds
    assert float(found.shift.abs().max()) < shift
    assert float((found.ratio - 1.0).abs().max()) < ratio
