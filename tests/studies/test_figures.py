# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The figures of the studies on drives that are made up so that every figure is known."""

import math

import numpy as np
import pytest
import torch
from scipy import stats
from torch import Tensor

from studies.accuracy.scores import (
    CONFIDENCE,
    ROWS,
    Judged,
    observation_times,
    pool,
    row_mask,
    score,
    share_of,
)
from studies.change.drives import Change, Followed
from studies.change.scores import rate_limits, score_change
from studies.paper.scores import quartiles
from studies.quantiles import quantile_of
from studies.tables import table
from terrain_estimator.model.row_names import row_names

TRUTH = (2000.0, 0.5)


def tensor(values: object) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)


def judged(
    shares: list[tuple[float, float]], sd: tuple[float, float] = (200.0, 0.05), bound: float = 0.5
) -> Judged:
    """Drives whose errors are ``shares`` of the published deviations ``sd``."""
    count, spread = len(shares), tensor(sd)
    mean = (tensor(TRUTH) + tensor(shares) * spread).unsqueeze(1)
    covariance = torch.diag(spread**2).expand(count, 1, 2, 2)
    blocks = tensor([[8.0, 4.0, 2.0, 1.0]]).expand(count, 4)
    velocity = tensor([[10.0, 9.0, -30.0, 4e-3, 1e-3]]).expand(count, 5)
    return Judged(
        truth=tensor([TRUTH]).expand(count, 2),
        mean=mean.expand(count, 1, 2),
        covariance=covariance,
        least=(bound * spread).expand(count, 1, 2),
        prior_sd=tensor([1300.0, 0.1]).expand(count, 2),
        stuck=torch.zeros(count, dtype=torch.float64),
        blocks=blocks,
        velocity=velocity,
        velocity_sd=torch.full((count,), 0.005, dtype=torch.float64),
    )


# shares and their limits


@pytest.mark.parametrize(("hits", "count"), [(0, 20), (3, 20), (19, 20), (20, 20), (240, 250)])
def test_the_limits_of_a_share_are_those_of_clopper_and_pearson(hits: int, count: int) -> None:
    found = share_of(torch.arange(count) < hits)
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = stats.beta.ppf(tail, hits, count - hits + 1) if hits else 0.0
    high = stats.beta.isf(tail, hits + 1, count - hits) if hits < count else 1.0
    assert found.value == pytest.approx(hits / count)
    assert (found.low, found.high) == pytest.approx((low, high), abs=1e-9)


def test_the_limits_of_a_rate_are_those_of_poisson() -> None:
    for count in (0, 1, 12):
        low, high = rate_limits(count, 2.5)
        tail = 0.5 * (1.0 - CONFIDENCE)
        assert stats.poisson.cdf(count, 2.5 * high) == pytest.approx(tail)
        if count:
            assert stats.poisson.sf(count - 1, 2.5 * low) == pytest.approx(tail)
        else:
            assert low == 0.0


def test_a_quantile_lies_between_order_statistics_that_hold_it_with_confidence() -> None:
    """1000 samples of 60 values: the median's limits fail in about 1 %, less than 25 of 1000 in
    99.99 % of the cases."""
    generator = np.random.default_rng(1)
    missed = 0
    for _ in range(1000):
        found = quantile_of(generator.normal(size=60), 0.5)
        assert found.low <= found.value <= found.high
        missed += not found.low <= 0.0 <= found.high
    assert missed < 25
    values = np.arange(1.0, 11.0)
    assert quantile_of(values, 0.5).value == 5.0
    assert quantile_of(values, 0.9).value == 9.0
    assert quantile_of(values, 0.91).value == 10.0
    assert quantile_of(np.array([3.0]), 0.9) == quantile_of(np.array([3.0]), 0.1)
    assert quantile_of(np.array([1.0, math.inf, 2.0]), 0.9).value == math.inf


# accuracy


def test_errors_and_coverages_are_those_of_the_drives() -> None:
    shares = [(0.5, -1.0), (-1.5, 1.9), (2.5, 0.0), (1.0, -3.0)]
    found = score(judged(shares))
    assert found.episodes == 4
    absolute = np.abs(np.array(shares))
    assert found.cohesion.coverage_95.value == 0.75
    assert found.cohesion.coverage_68.value == 0.25
    assert found.tan_phi.coverage_95.value == 0.75
    assert found.tan_phi.coverage_68.value == 0.25
    for column, parameter, sd in ((0, found.cohesion, 200.0), (1, found.tan_phi, 0.05)):
        relative = absolute[:, column] * sd / TRUTH[column]
        assert parameter.median_error[0] == pytest.approx(np.median(relative))
        assert parameter.p90_error[0] == pytest.approx(np.quantile(relative, 0.9))
        median = stats.norm.ppf(0.75)
        assert parameter.bound[0] == pytest.approx(median * 0.5 * sd / TRUTH[column])
        expected = np.median(absolute[:, column]) / 0.5 / median
        assert parameter.ratio_to_bound[0] == pytest.approx(expected)
        assert parameter.narrowest == pytest.approx(2.0)
    distance = (np.array(shares) ** 2).sum(1)
    joint = np.mean(distance < stats.chi2.ppf(0.95, 2))
    assert found.joint_coverage_95.value == pytest.approx(joint)
    scaled = np.diag([0.2, 0.05]) ** 2
    errors = np.array(shares) * [0.2, 0.05]
    nll = -stats.multivariate_normal(np.zeros(2), scaled).logpdf(errors).mean()
    assert found.nll == pytest.approx(nll)


def test_a_parameter_counts_as_identified_by_its_own_prior() -> None:
    """A tenth of the prior variance is left, or less."""
    found = score(judged([(0.0, 0.0)] * 3, sd=(1300.0 * 0.31, 0.1 * 0.32)))
    assert (found.cohesion.identified, found.tan_phi.identified) == (1.0, 0.0)


def test_blocks_and_predictions_are_summed_over_all_drives() -> None:
    calm, wild = judged([(0.0, 0.0)]), judged([(0.0, 0.0)])
    wild = wild._replace(
        blocks=tensor([[30.0, 6.0, 3.0, 3.0]]),
        velocity=tensor([[30.0, 21.0, -50.0, 5e-3, 8e-3]]),
        velocity_sd=tensor([0.03]),
        stuck=tensor([1.0]),
    )
    found = score(pool([calm, wild]))
    assert found.stuck == 0.5
    assert found.nis == pytest.approx(38.0 / 10.0)
    assert found.nis_above_95 == pytest.approx(4.0 / 5.0)
    assert found.velocity_coverage_95 == pytest.approx(30.0 / 40.0)
    assert found.velocity_calibration == pytest.approx(1.0)
    assert found.velocity_nll == pytest.approx(0.5 * -80.0 / 40.0)
    assert found.velocity_spread == pytest.approx(0.5)  # the lower of two, over 0.01 m/s


def test_an_estimator_that_is_honest_and_efficient_scores_so() -> None:
    """20000 drives with errors of the published deviation, which is the bound: every figure within
    4 standard errors of its nominal value."""
    errors = torch.randn(20000, 2, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    found = score(judged(errors.tolist(), bound=1.0))
    error = 4.0 * math.sqrt(0.95 * 0.05 / 20000)
    for parameter in (found.cohesion, found.tan_phi):
        assert parameter.coverage_95.value == pytest.approx(0.95, abs=error)
        assert parameter.coverage_68.value == pytest.approx(0.68, abs=0.0132)
        assert parameter.ratio_to_bound[0] == pytest.approx(1.0, abs=0.05)
        assert parameter.narrowest == pytest.approx(1.0)
    assert found.joint_coverage_95.value == pytest.approx(0.95, abs=error)


def test_a_mask_names_the_rows_that_an_estimator_is_given() -> None:
    for rows, (velocity, load, torque, moment) in ROWS.items():
        wanted = {"velocity": velocity, "load": load, "acceleration": 0}
        wanted |= {f"torque_{axle}": torque for axle in range(3)}
        wanted |= {"moment": moment, "bogie_moment": moment}
        expected = [wanted[name] for name in row_names(3)]
        assert row_mask(rows, 3).tolist() == expected


def test_times_are_the_last_observations_before_them() -> None:
    assert observation_times((5.0, 10.0, 40.0)).tolist() == [49, 99, 399]


# changes


def followed(delays: list[float], errors: Tensor, fresh: Tensor) -> Followed:
    count, seconds, _ = errors.shape
    covered = np.ones((count, seconds, 2))
    return Followed(
        np.array(delays),
        np.full(count, 4.0),
        errors.numpy(),
        np.where(np.isnan(errors.numpy()), np.nan, covered),
        fresh.numpy(),
        np.full(count, 90.0),
        np.array([1.0] + [0.0] * (count - 1)),
        np.zeros(count),
    )


CHANGE = Change("mars_rover", "loose_sand", "compact_sand")


def test_a_change_is_scored_by_its_delays_and_by_when_the_ground_is_known_again() -> None:
    """The error falls to that of the fresh estimator at second 12 for c, and 6 for tan phi.

    The last axle crosses at 4 s.
    """
    seconds = 46
    errors = torch.full((4, seconds, 2), 0.1, dtype=torch.float64)
    errors[:, :12, 0], errors[:, :6, 1] = 0.5, 0.5
    fresh = torch.full_like(errors, 0.09)
    errors[3, 20:], fresh[3, 20:] = torch.nan, torch.nan
    found = score_change(CHANGE, followed([2.0, 3.0, math.inf, 50.0], errors, fresh))
    assert found.drives == (4, 4, 3)
    assert found.crossing_s == 4.0
    assert found.detected == 0.5
    assert found.delay_median_s.value == 3.0
    assert found.recovered_s == (8.0, 2.0)
    assert found.error_15_s == pytest.approx((0.1, 0.1))
    assert found.fresh_15_s == pytest.approx((0.09, 0.09))
    assert found.coverage_40_s == (1.0, 1.0)
    assert found.before.hours == pytest.approx(0.1)
    assert found.before.alarms == 1


def test_ground_is_never_known_where_the_last_second_is_not_good() -> None:
    errors = torch.full((3, 46, 2), 0.1, dtype=torch.float64)
    errors[:, 34, 1] = 0.9
    fresh = torch.full_like(errors, 0.1)
    found = score_change(CHANGE, followed([1.0] * 3, errors, fresh))
    assert found.recovered_s == (0.0, math.inf)  # the last axle crosses at 4 s


# tables


def test_a_table_of_markdown_has_its_head_a_rule_and_its_lines() -> None:
    lines = table(["a", "b"], [["1", "2"], ["3", "4"]]).splitlines()
    assert lines == ["| a | b |", "| --- | --- |", "| 1 | 2 |", "| 3 | 4 |"]


def test_quartiles_are_numpys() -> None:
    values = [3.0, 1.0, 4.0, 1.5, 9.0]
    assert quartiles(tensor(values)) == pytest.approx(np.quantile(values, [0.25, 0.5, 0.75]))
