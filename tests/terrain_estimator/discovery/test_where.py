# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Disagreeing rows: false alarms on noise alone, and known effects in the right row."""

import numpy as np
import pytest
import torch
from scipy.stats import binomtest
from torch import Tensor

from terrain_estimator.discovery.locate.where import LEVEL, disagreements, holm, tests, two_sided
from terrain_estimator.discovery.locate.whitening import innovations, whitening
from tests.terrain_estimator.discovery.known import SIZES, study

tests.__test__ = False  # type: ignore[attr-defined]
RUNS, BLOCKS, ROWS, COLUMNS = 3, 50, 2, 24


def autoregressive(shape: tuple[int, ...], kept: float, generator: torch.Generator) -> Tensor:
    white = torch.randn(shape, generator=generator, dtype=torch.float64)
    series = [white[0]]
    for now in white[1:]:
        series.append(kept * series[-1] + (1.0 - kept**2) ** 0.5 * now)
    return torch.stack(series)


@pytest.mark.parametrize("kept", [0.0, 0.7])
def test_noise_alone_raises_an_alarm_no_more_often_than_the_level_however_long_it_lasts(
    kept: float,
) -> None:
    """Test 200 sets of three runs with smooth signals; 95 % limits by the binomial law."""
    generator = torch.Generator().manual_seed(17)
    signals = [
        autoregressive((BLOCKS, 1, COLUMNS // 2), 0.9, generator).expand(-1, ROWS, -1)
        for _ in range(RUNS)
    ]
    columns = [torch.cat([signal, (signal > 0.8).double()], 2) for signal in signals]
    trials, alarms = 200, 0
    for _ in range(trials):
        left = [autoregressive((BLOCKS, ROWS), kept, generator) for _ in range(RUNS)]
        alarms += bool(
            holm(two_sided(tests(left, columns), torch.zeros(COLUMNS, dtype=torch.float64))).min()
            < LEVEL
        )
    assert binomtest(alarms, trials).proportion_ci(0.95).low <= LEVEL


def test_p_values_are_adjusted_after_holm() -> None:
    assert holm(np.array([[0.01, 0.04], [0.03, 0.005]])).tolist() == [[0.03, 0.06], [0.06, 0.02]]


def test_what_noise_shared_with_a_signal_can_do_counts_for_nothing() -> None:
    generator = torch.Generator().manual_seed(5)
    columns = [torch.ones(BLOCKS, 1, 1, dtype=torch.float64)]
    found = tests([0.5 + torch.randn(BLOCKS, 1, generator=generator, dtype=torch.float64)], columns)
    assert two_sided(found, torch.zeros(1))[0, 0] < two_sided(found, torch.full((1,), 0.2))[0, 0]
    assert two_sided(found, torch.ones(1)).min() == 1.0


def test_innovations_of_a_fit_to_which_nothing_is_missing_are_white_and_of_unit_variance() -> None:
    known = study("")
    with torch.inference_mode():
        every = [
            innovations(whitening(equations, unknowns), equations, unknowns)
            for equations, unknowns in zip(
                known.equations_of_nothing(), known.nothing.fit.point.runs, strict=True
            )
        ]
    # The second row carries the velocity from block to block: alone it says nothing.
    left = torch.stack(every)[:, :, [0, 2, 3, 4, 5, 6, 7, 8]]
    assert 0.7 < float(left.var()) < 1.2
    assert abs(float((left[:, 1:] * left[:, :-1]).mean())) < 4.0 / left.numel() ** 0.5


def test_nothing_is_listed_where_nothing_is_missing() -> None:
    with torch.inference_mode():
        assert disagreements(study("")) == []


def test_a_tilted_attitude_sensor_shows_in_the_velocity_row_as_its_share_of_gravity() -> None:
    with torch.inference_mode():
        found = disagreements(study("slope_bias"))
    first = next(each for each in found if each.row in ("velocity", "acceleration"))
    assert abs(first.strength) == pytest.approx(3.72 * SIZES["slope_bias"], rel=0.3)
    assert first.unit == "m/s^2"
    assert first.p < 0.05
    assert first.sentence.startswith(f"{first.row} row, ")
    assert all(each.p <= LEVEL for each in found)
