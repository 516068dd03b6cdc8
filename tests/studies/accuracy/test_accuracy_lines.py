# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The page of ``make accuracy`` on made-up estimates, deviations and bounds."""

import pytest
import torch

from studies.accuracy.cells import CellBatch, Setting
from studies.accuracy.lines import TableLine, lines
from studies.accuracy.scores import TIMES_S, Judged
from studies.accuracy.targets import Verdict, verdicts
from terramechanics.simulation.sensors import Noise

DRIVES = 100
TRUTH = torch.tensor([2000.0, 0.6], dtype=torch.float64).repeat(DRIVES, 1)
PRIOR_SD = torch.tensor([1000.0, 0.2], dtype=torch.float64).repeat(DRIVES, 1)


def judged(deviation: torch.Tensor, bound: float, off: float, velocity_sd: float) -> Judged:
    """Return drives with shares [N] of the prior's deviations, ``off`` deviations from truth."""
    at_times = (DRIVES, len(TIMES_S), 2)
    sd = (deviation.unsqueeze(1) * PRIOR_SD).unsqueeze(1).expand(at_times)
    velocity = torch.tensor(
        [350.0, 335.0, 350.0, 350.0 * velocity_sd**2, 350.0 * velocity_sd**2], dtype=torch.float64
    )
    return Judged(
        truth=TRUTH,
        mean=TRUTH.unsqueeze(1) + off * sd,
        covariance=torch.diag_embed(sd**2),
        least=(bound * PRIOR_SD).unsqueeze(1).expand(at_times),
        prior_sd=PRIOR_SD,
        stuck=torch.zeros(DRIVES, dtype=torch.float64),
        blocks=torch.ones(DRIVES, 4, dtype=torch.float64),
        velocity=velocity.repeat(DRIVES, 1),
        velocity_sd=torch.full((DRIVES,), velocity_sd, dtype=torch.float64),
    )


def line(
    rows: str, values: Judged, model: str = "physics", soil: str = "compact_sand"
) -> TableLine:
    (found,) = lines(Setting("paper_rover", soil), [CellBatch({(rows, model): values}, [], [])])
    return found


def found_of(of: list[TableLine], what: str, model: str = "physics") -> Verdict:
    (verdict,) = [verdict for verdict in verdicts(of, model) if verdict[0].startswith(what)]
    return verdict


def test_claims_are_counted_drive_by_drive() -> None:
    deviation = torch.linspace(0.1, 1.0, DRIVES, dtype=torch.float64)
    claim = line("v", judged(deviation, 0.5, 2.5, 0.01)).cohesion
    called = int((deviation**2 <= 0.1).sum())
    assert 0 < called < DRIVES
    assert claim.least == pytest.approx(0.2)
    assert claim.unfounded == pytest.approx(called / DRIVES)
    assert claim.covered is not None
    assert (claim.covered.value, claim.covered.low) == (0.0, 0.0)


def test_what_the_bound_allows_is_no_unfounded_claim_and_what_is_not_claimed_has_no_coverage() -> (
    None
):
    deviation = torch.full((DRIVES,), 0.3, dtype=torch.float64)
    assert line("v", judged(deviation, 0.3, 0.0, 0.01)).tan_phi.unfounded == 0.0
    assert line("v", judged(2.0 * deviation, 0.3, 0.0, 0.01)).tan_phi.covered is None


@pytest.mark.parametrize(("ratio", "met"), [(1.1, "yes"), (2.0, "**no**")])
def test_the_spread_of_the_velocity_is_judged_against_the_sensor(ratio: float, met: str) -> None:
    values = judged(
        torch.full((DRIVES,), 0.9, dtype=torch.float64), 0.9, 1.0, ratio * Noise().velocity
    )
    *_, said, verdict = found_of(
        [line("v+L+M", values)], "velocity filter, predicted deviation / noise of the sensor"
    )
    assert (said, verdict) == (f"{ratio:.2f} to {ratio:.2f}", met)


def test_an_interval_that_one_drive_has_too_narrow_is_a_miss() -> None:
    deviation = torch.full((DRIVES,), 0.9, dtype=torch.float64)
    deviation[7] = 0.6
    narrow, wide = (
        line("v+L+M", judged(values, 0.9, 1.0, 0.01))
        for values in (deviation, deviation.clamp(min=0.9))
    )
    assert found_of([narrow], "compact sand: least deviation")[-1] == "**no**"
    assert found_of([wide], "compact sand: least deviation")[-1] == "yes"


def test_every_row_set_has_a_verdict_and_a_model_that_ships_has_its_own() -> None:
    everywhere = torch.full((DRIVES,), 0.2, dtype=torch.float64)
    honest, narrow = judged(everywhere, 0.2, 0.5, 0.01), judged(everywhere, 0.6, 3.0, 0.01)
    found = [line("v", narrow), line("v+L+M", honest), line("v+L+M+B", narrow, "shipped")]
    assert found_of(found, "coverage of the 95 % interval, v and v+L, exact")[-1] == "**no**"
    assert (
        "2 of 2 outside: c, paper_rover, compact_sand, exact, v: 0.0"
        in found_of(found, "coverage of the 95 % interval, v and v+L")[2]
    )
    assert found_of(found, "coverage of the 95 % interval, exact", "shipped")[2].startswith(
        "0.0 to 0.0 %"
    )
    assert found_of(found, "coverage of the 95 % interval, exact")[2:] == (
        "100.0 to 100.0 %",
        "yes",
    )  # 100 of 100 may be 97 %
    assert found_of(found, "identified, though")[-1] == "yes"
    assert found_of(found, "the same, v and v+L")[-1] == "**no**"
