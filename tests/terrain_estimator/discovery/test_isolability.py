# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Expected log Bayes factors against their closed form, and effects that two drives separate."""

import pytest
import torch
from torch import Tensor

from terrain_estimator.discovery.evidence.expected import Stage, loss
from terrain_estimator.discovery.evidence.isolability import isolability
from terrain_estimator.discovery.hypotheses.library import singles
from terrain_estimator.discovery.next_drive.manoeuvres import MANOEUVRES
from terrain_estimator.discovery.next_drive.next_drive import next_drives
from tests.terrain_estimator.discovery.known import study

BLOCKS, ROWS, OWN = 30, 3, 4


def stage() -> Stage:
    generator = torch.Generator().manual_seed(3)
    mixing = torch.randn(BLOCKS, ROWS, ROWS, generator=generator, dtype=torch.float64)
    noise = mixing @ mixing.transpose(1, 2) + torch.eye(ROWS, dtype=torch.float64)
    own = torch.randn(BLOCKS, ROWS, OWN, generator=generator, dtype=torch.float64)
    return Stage(
        noise,
        torch.ones(BLOCKS, ROWS, dtype=torch.float64),
        own,
        torch.full((OWN,), 0.5, dtype=torch.float64),
    )


def table(columns: int) -> Tensor:
    return torch.randn(
        BLOCKS, ROWS, columns, generator=torch.Generator().manual_seed(4), dtype=torch.float64
    )


def test_a_small_signature_gains_half_its_square_under_the_marginal_covariance() -> None:
    one, signature = stage(), 0.1 * table(1)
    own = one.own.flatten(0, 1)
    noise = torch.block_diag(*one.covariance)  # type: ignore[no-untyped-call]
    marginal = noise + own @ torch.diag(1.0 / one.precision) @ own.T
    flat = signature.flatten()
    assert loss([one], [signature], None).nats == pytest.approx(
        float(0.5 * flat @ torch.linalg.solve(marginal, flat)), rel=0.02
    )


def test_a_large_mark_counts_as_noise_and_gains_with_its_logarithm() -> None:
    one, signature = stage(), table(1)
    ten, hundred = (loss([one], [factor * signature], None).nats for factor in (100.0, 1000.0))
    assert hundred - ten == pytest.approx(BLOCKS * ROWS * 2.302585, rel=0.1)


def test_an_effect_with_the_same_mark_explains_it_at_a_size_in_its_range_alone() -> None:
    one = stage()
    double = torch.cat([2.0 * table(1), table(1)], 2)
    assert loss([one], [double], (0.0, 5.0)).nats < 0.5
    assert loss([one], [double], (0.0, 1.0)).nats == pytest.approx(
        loss([one], [table(1)], None).nats, rel=0.05
    )
    assert loss([one], [double], (-5.0, 0.0)).nats == pytest.approx(
        loss([one], [2.0 * table(1)], None).nats, rel=0.05
    )


def test_what_another_run_holds_counts_with_the_same_size() -> None:
    one = stage()
    signature, other = table(2)[..., :1], table(2)[..., 1:]
    alike, opposite = torch.cat([signature, signature], 2), torch.cat([signature, -signature], 2)
    assert loss([one, one], [alike, alike], (-5.0, 5.0)).nats < 0.5
    both = loss([one, one], [alike, opposite], (-5.0, 5.0)).nats
    assert both > loss([one], [signature], None).nats
    assert loss([one], [torch.cat([signature, other], 2)], (-5.0, 5.0)).nats > 1.0


def test_drags_are_nearest_to_each_other_and_what_a_planar_rover_cannot_show_is_named() -> None:
    with torch.inference_mode():
        found = isolability(
            study(""), singles(("drive_drag", "coulomb_drag", "slope_bias")), study("").nothing
        )
    assert found.nearest("drive_drag") == "coulomb_drag"
    assert found.nearest("coulomb_drag") == "drive_drag"
    i, j = found.names.index("drive_drag"), found.names.index("slope_bias")
    assert found.nats[i, j] > 0.5 * found.nats[i, i] > 10.0
    assert "sideways" in found.not_testable["lateral_bulldozing"]


def test_of_two_drags_a_drive_at_two_speeds_tells_much_and_a_steady_one_next_to_nothing() -> None:
    tried = [each for each in MANOEUVRES if each.name in ("steady", "two_speeds")]
    with torch.inference_mode():
        found = next_drives(
            study(""), singles(("drive_drag", "coulomb_drag")), study("").nothing, tried
        )
    assert [each.name for each in found] == ["two_speeds", "steady"]
    assert found[0].nats > 10.0 > found[1].nats
    assert set(found[0].pair) == {"drive_drag", "coulomb_drag"}


def test_nothing_is_to_be_driven_where_nothing_is_in_doubt() -> None:
    assert next_drives(study(""), singles(("drive_drag",)), study("").nothing) == []
