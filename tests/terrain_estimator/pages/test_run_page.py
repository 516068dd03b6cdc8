# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The report of a replay as text; test_in_browser.py opens it."""

import dataclasses
import re

import pytest

from terrain_estimator.outcome import Outcome
from terrain_estimator.pages.run import run_page
from tests.terrain_estimator.pages.runs import OBSERVATIONS, ORIGIN, one, report, run


def test_the_same_runs_give_the_same_page_which_names_no_outside_address() -> None:
    text = report()
    assert text == run_page([run(), dataclasses.replace(run(12, true=False), name="rock")], ORIGIN)
    assert (
        re.findall(
            r"""(?:src|href)=["'](?![#"']|data:,)|url\((?!#)|@import|<script|//[a-z]+\.[a-z]""",
            text,
        )
        == []
    )


def test_the_page_shows_the_last_estimate_beside_the_truth() -> None:
    text = one()
    mean, sd = 1e-3 * (900.0 + OBSERVATIONS - 1), 2.0 / OBSERVATIONS**0.5
    shown = [
        float(each)
        for each in re.findall(r"c \[kPa\]</th>.*?</tr>", text, re.DOTALL)
        for each in re.findall(r'value="([^"]+)"', each)
    ]
    assert shown == pytest.approx(
        [mean, sd, mean - 1.96 * sd, mean + 1.96 * sd, 1.8, 100.0 * (mean - 1.8) / 1.8]
    )
    assert "tan phi is identified, c is not" in text
    assert "loose_sand then compact_sand with drive_drag 0.2 N m s/rad" in text
    assert "true change" in text


def test_slip_and_sinkage_of_every_wheel_are_shown_over_time_as_means_of_equal_spans() -> None:
    figures = r'<figure id="run-1-(?:slip|sinkage)".*?</figure>'
    slip, sinkage = re.findall(figures, one(), re.DOTALL)
    for shown in (slip, sinkage):
        for wheel in ("front left", "front right", "rear left", "rear right"):
            assert f'<th scope="col">{wheel}</th>' in shown
    rows = re.findall(r'<th scope="row">([\d.]+)</th>(.*?)</tr>', slip)
    span = 16  # observations: 120 spans of 8 are too few for 1000
    for time_s, cells in rows[:-1]:
        share = (float(time_s) * 10.0 - 0.5 * (span - 1)) / OBSERVATIONS
        values = [float(each) for each in re.findall(r'value="([^"]+)"', cells)]
        later = [0.4, 0.2] if float(time_s) * 10.0 >= OBSERVATIONS / 2 else [0.2]
        assert values == pytest.approx([share - 0.1, share, *later])
    assert "rear left at most 0.4, at the end 0.4" in slip
    assert "front left at most 29.9, at the end 29.9" in sinkage


def test_a_run_whose_model_does_not_fit_has_no_estimate() -> None:
    finding = "the model does not fit this rover or ground: 2 of the last 20 seconds were taken"
    text = run_page([dataclasses.replace(run(), disagreements=[finding])], ORIGIN)
    assert f"<strong>T{finding[1:]}.</strong> There is no estimate" in text
    for words in ("identified</strong>", "Estimates at the end", "Soils by probability"):
        assert words not in text
    assert "seconds of driving were taken, and" in text


def test_where_the_estimate_was_withheld_the_pictures_say_so() -> None:
    withheld = run()
    for k, span in enumerate(withheld.history.spans):
        span.disagrees = 4 * k >= 3 * len(withheld.history.spans)
    text = run_page([withheld], ORIGIN)
    assert text.count("in 25% of the time it is the prior, as the model does not fit") == 2
    assert "it is the prior" not in one()


def test_without_truth_none_is_drawn_and_the_page_says_so() -> None:
    text = run_page([run(true=False)], ORIGIN)
    assert "The bag does not contain the true ground." in text
    assert not re.search("true change|True ground|>truth</text>", text)


def test_refused_observations_stand_with_their_count_and_what_to_do() -> None:
    text = one()
    assert Outcome.GATED.advice in text
    assert re.search(
        r'GATED</code></th><td class="figure" data-label="Observations"><data value="10.0">10<',
        text,
    )
    assert re.search(
        r'wheel_slip</th><td class="figure"><data value="1000.0">1000<.*value="3.0">3<', text
    )
    assert "GATED 10 times, from 50 to 51 s" in text


def test_the_fit_of_every_row_is_on_the_page() -> None:
    text = one()
    assert "Fit of the rows at the end of dune" in text
    assert re.search(r'load</th><td class="figure"><data value="-0.5">.*<data value="0.75">', text)


def test_a_run_of_one_observation_and_one_of_none_have_their_page() -> None:
    assert "NaN" not in run_page([run(1)], ORIGIN)
    assert "No estimate from this bag" in run_page([run(0)], ORIGIN)


def test_configuration_hashes_and_citations_are_on_the_page() -> None:
    text = one()
    assert "Not at their defaults: prior.soil." in text
    for told in ("ab" * 32, "cd" * 32, "ef" * 32, "A law of sand", "use pitch and acceleration"):
        assert told in text
    untouched = dataclasses.replace(ORIGIN, parameters=ORIGIN.parameters[:1])
    assert "All parameters are at their defaults." in run_page([run(1)], untouched)


def test_names_of_bags_are_text_and_never_markup() -> None:
    hostile = "<script>alert(1)</script>"
    text = run_page([dataclasses.replace(run(3), name=hostile, bag=hostile)], ORIGIN)
    assert "<script" not in text
    assert "&lt;script&gt;" in text
