# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A leak is found, noise is not."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from benchmarks.trend import SIGNIFICANCE, counted, trend

SAMPLES, RUNS = 500, 100
TIMES = np.arange(SAMPLES, dtype=float)
ALLOWED = 0.01


def noise(seed: int, memory: float) -> NDArray[np.float64]:
    """Draw 300 MB with a deviation of 3 MB, white or correlated."""
    generator = np.random.default_rng(seed)
    steps = generator.normal(0.0, 3.0 * np.sqrt(1.0 - memory**2), SAMPLES)
    steps[0] /= np.sqrt(1.0 - memory**2)
    for place in range(1, SAMPLES):
        steps[place] += memory * steps[place - 1]
    return 300.0 + steps


@pytest.mark.parametrize("memory", [0.0, 0.8])
def test_noise_is_no_growth(memory: float) -> None:
    """Test 100 runs: more alarms have a probability of 1 in 1000 at the stated significance."""
    alarms = sum(trend("memory", TIMES, noise(seed, memory), ALLOWED).grows for seed in range(RUNS))
    assert alarms <= stats.binom.ppf(0.999, RUNS, SIGNIFICANCE)


def test_a_leak_of_three_percent_is_found_in_that_noise() -> None:
    """In all of 100 runs: the share that is found is above 97 % with 95 % confidence."""
    leak = 9.0 * TIMES / SAMPLES / 0.8
    found = sum(
        trend("memory", TIMES, noise(seed, 0.0) + leak, ALLOWED).grows for seed in range(RUNS)
    )
    assert found == RUNS


def test_a_warm_up_a_single_jump_and_a_page_are_no_growth() -> None:
    assert not trend("memory", TIMES, 300.0 - 100.0 * np.exp(-TIMES / 20.0), ALLOWED).grows
    assert not trend("memory", TIMES, np.where(TIMES > 490.0, 400.0, 300.0), ALLOWED).grows
    assert not trend("memory", TIMES, 300.0 + 0.004 * TIMES / SAMPLES, ALLOWED).grows
    assert not trend("memory", TIMES, np.full(SAMPLES, 300.0), ALLOWED).grows
    assert trend("memory", TIMES, 300.0 + 6.0 * TIMES / SAMPLES, ALLOWED).grows


def test_a_rate_may_drift_neither_way() -> None:
    falling = 40.0 - 2.0 * TIMES / SAMPLES
    assert trend("rate", TIMES, falling, ALLOWED, both_ways=True).grows
    assert not trend("rate", TIMES, falling, ALLOWED).grows


def test_counters_may_move_in_the_warm_up_alone() -> None:
    assert not counted("lost", TIMES, np.where(TIMES > 20.0, 3.0, 0.0)).grows
    assert counted("lost", TIMES, np.where(TIMES > 300.0, 4.0, 3.0)).grows


def test_a_run_that_is_too_short_is_refused() -> None:
    with pytest.raises(
        ValueError, match="40 samples after the warm-up, the test needs 50: run longer"
    ):
        trend("memory", TIMES[:50], TIMES[:50], ALLOWED)
