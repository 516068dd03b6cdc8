# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The report as text; test_in_browser.py opens it."""

import re
from typing import Any

import pytest
from jinja2 import UndefinedError

from terrain_estimator.pages import page
from terrain_estimator.pages.finding import Unsealed, finding_page
from terrain_estimator.pages.finding_words import doubt_note
from tests.terrain_estimator.pages.findings import finding, report

PLAIN: dict[str, Any] = {"where": [], "proof": None}
"""Without most of the pictures, which take their time to be drawn."""


def test_the_same_finding_gives_the_same_page() -> None:
    assert report("named") == finding_page(finding("named"))


@pytest.mark.parametrize("verdict", ["none", "soil", "named", "confusable", "unknown"])
def test_the_report_names_no_outside_address(verdict: str) -> None:
    text = report(verdict)
    assert (
        re.findall(
            r"""(?:src|href)=["'](?![#"']|data:,)|url\((?!#)|@import|<script|//[a-z]+\.[a-z]""",
            text,
        )
        == []
    )


@pytest.mark.parametrize(
    ("verdict", "headline"),
    [
        ("none", "No missing effect found"),
        ("soil", "The soil differs from its file"),
        ("named", "The model lacks drive_drag"),
        ("confusable", "The model lacks drive_drag or coulomb_drag"),
        ("unknown", "Something is missing that no considered effect explains"),
    ],
)
def test_the_headline_says_the_verdict_in_words(verdict: str, headline: str) -> None:
    text = report(verdict)
    assert f"<h1>{headline}</h1>" in text
    assert f"<title>{headline}</title>" in text


def test_constants_that_differ_are_listed_with_the_file_and_its_proof() -> None:
    text = report("soil")
    assert "n 1.01 ± 0.02 instead of 1.1, shear_modulus 0.0181 ± 0.0005 instead of 0.025" in text
    assert "c2 0.319" not in text  # within two deviations: only in the table
    assert "Soil file: soils/loose_sand_found.yaml" in text
    assert "The revised soils hold on held-out runs." in text
    beside = finding("named") | PLAIN | {"soils": finding("soil")["soils"]}
    assert "The soil file does not fit, either: soil loose_sand (2 runs): n 1.01" in finding_page(
        beside
    )
    assert 'id="soils"' not in report("named")


def test_an_unknown_verdict_names_the_dependence_and_a_name_that_held_out_runs_refuted() -> None:
    assert (
        "The closest is slope_bias. What remains depends most on distance in the velocity row."
        in report("unknown")
    )
    more = finding("unknown") | {"not_tried": ["contact_law_scm"]}
    assert "--library contact_law_scm tries one more: The ground follows" in finding_page(more)
    refuted = finding("unknown")
    refuted["proof"] = {
        "effect": "slope_bias",
        "added": False,
        "sentence": "slope_bias is not added",
    }
    assert (
        "slope_bias fitted the searched runs, but did not prove itself on the held-out"
        " runs." in finding_page(refuted)
    )


def test_a_name_on_the_soil_as_told_says_which_soil_held_out_runs_refuted() -> None:
    refuted = [each | {"file": None} for each in finding("soil")["soils"]]
    told = finding("named") | {"soils": [], "refuted_soils": refuted}
    told["soil_proof"] = {"holds": False, "sentence": "the revised soils do not hold"}
    found = finding_page(told)
    assert "Another soil fits the searched runs, and did not hold on held-out runs: soil " in found
    assert "held-out runs contradict it: no soil file is written." in found
    assert "All fits below are on the soil as told." in found
    assert "The revised soils do not hold." in found
    assert "on the soil found" not in found
    assert "Soil file:" not in found


def test_an_unknown_that_only_rollouts_show_says_so() -> None:
    surprised = finding("unknown") | {"effects": []}
    surprised["gap"] |= {"before": 6.5, "noise_floor": 1.3}
    text = finding_page(surprised)
    assert "<h1>Something is missing that no row shows</h1>" in text
    assert (
        "Something is missing that no row of the fit shows; rollouts of held-out runs miss by 6.50"
        " sd of the sensors, 5.0 times the noise floor." in text
    )


@pytest.mark.parametrize("verdict", ["named", "confusable", "unknown", "none", "soil"])
def test_the_first_two_paragraphs_have_no_unit_of_likelihood(verdict: str) -> None:
    given = finding(verdict)
    given["proof"]["sentence"] += "; one second ahead a value is 1.2 to 1.9 nat likelier"
    shown = finding_page(given).partition("<h1")[2]
    paragraphs = re.findall(r"<p[^>]*>(.*?)</p>", shown, re.DOTALL)
    assert any("nat likelier" in each for each in paragraphs)
    assert not any(re.search(r"\bnat\b", each) for each in paragraphs[:2])


def test_runs_that_were_not_used_stand_with_the_reason() -> None:
    text = finding_page(finding("named") | {"left_out": ["bags/rain is left out: no pitch"]})
    assert "<li>bags/rain is left out: no pitch.</li>" in text


def test_every_signal_of_the_worst_window_is_drawn_the_two_worst_in_the_open() -> None:
    text = report("named")
    first, others = text.index('id="rollout-slip_0"'), text.index("All other measured signals")
    assert first < text.index('id="rollout-velocity"') < others < text.index("rollout-torque_2")


def test_what_to_drive_next_stands_with_what_it_is_expected_to_bring() -> None:
    text = report("confusable")
    assert (
        "<li>Drive 30 s at two speeds.</li>\n<li>For drive_drag alone: lift the wheels.</li>"
        in text
    )
    assert re.search(
        r'at two speeds</th><td class="figure"><data value="30.0">.*drive_drag against'
        r' coulomb_drag.*value="17.25"',
        text,
    )
    assert "There are no effects to separate." in report("none")


def test_what_a_finding_lacks_is_said_to_be_absent() -> None:
    bare = finding("named")
    for key in ("proof", "isolability", "asked", "provenance"):
        del bare[key]
    bare |= {
        "gap": dict.fromkeys(("before", "after", "noise_floor", "closed", "closed_95")),
        "held_out": [],
    }
    text = finding_page(bare)
    assert "There is no proof on held-out runs: no run was held out." in text
    assert "No matrix was computed for these runs." in text
    assert "The finding has no record of its inputs." in text
    whole = report("named")
    assert not re.search("There is no proof|No matrix was|no record of its inputs", whole)


def test_what_was_hidden_stands_on_the_page_only_where_somebody_says_it() -> None:
    assert "What was hidden" not in report("named")
    truth = Unsealed(
        "A shear-thinning grease.",
        {run: {"cohesion_pa": 3001.0, "tan_phi": 0.6} for run in ("dune_1", "dune_2")},
    )
    text = finding_page(finding("named") | PLAIN, truth)
    assert "What was hidden" in text
    assert "A shear-thinning grease." in text
    assert '<data value="3.001">' in text  # in the table of the cohesions


@pytest.mark.parametrize(
    ("verdict", "leader", "headline"),
    [
        ("confusable", "none", "It is uncertain whether the model lacks drive_drag or"),
        ("named", "unknown", "Something is missing, perhaps drive_drag</h1>"),
    ],
)
def test_the_headline_follows_the_table_where_no_named_effect_leads_it(
    verdict: str, leader: str, headline: str
) -> None:
    given = finding(verdict)
    given["probabilities"] = dict.fromkeys(given["probabilities"], 0.04) | {leader: 0.9}
    text = finding_page(given)
    assert f"<h1>{headline}" in text
    assert "The most probable answer is that" in text
    assert doubt_note(verdict, given["probabilities"]) == f" (most probable: {leader}, 90%)"
    assert doubt_note(verdict, finding(verdict)["probabilities"]) == ""


def test_effects_that_act_together_are_one_alternative() -> None:
    given = finding("confusable") | PLAIN
    given["effects"] = [
        given["effects"][k] | {"name": name}
        for k, name in ((0, "drive_drag"), (1, "payload"), (1, "coulomb_drag"))
    ]
    given["confusable_with"] = ["coulomb_drag"]
    assert "<h1>The model lacks drive_drag with payload or coulomb_drag</h1>" in finding_page(given)


def test_an_effect_that_stands_for_an_exact_constant_is_said_to_be_one() -> None:
    words = "The rover file&#39;s mass may be wrong instead, and counts as exact here"
    given = finding("named") | PLAIN
    assert words not in finding_page(given)
    text = finding_page(given | {"exact_constants": ["mass"]})
    assert words in text
    assert "by --rover-sd mass=SD" in text


def test_it_begins_with_a_constant_of_the_rover_that_the_runs_move_far() -> None:
    mass = {
        "name": "mass",
        "unit": "kg",
        "told": 181.0,
        "told_sd": 1.81,
        "found": 185.6,
        "found_sd": 0.44,
        "moved": 2.54,
        "moved_sd": 0.24,
        "effect": "payload",
        "named": False,
        "notable": True,
    }
    tolerance = {"verdict": "named", "named": ["payload"], "rover_sd": {"mass": 1.81}}
    given = finding("none") | PLAIN | {"rover_constants": [mass], "rover_tolerance": tolerance}
    text = finding_page(given).split('id="rover"')[0]
    words = "mass is 4.6 kg too low, 2.5 of its stated deviations, or payload is missing."
    assert words in text
    assert (
        "With an exact rover file the answer is payload; files are usually off by as much" in text
    )
    assert "takes --rover-sd mass=1.8: state yours, or --rover-sd exact." in text
    near = given | {"rover_constants": [mass | {"moved": 0.5, "notable": False}]}
    assert words not in finding_page(near).split('id="rover"')[0]


def test_names_of_runs_are_text_and_never_markup_or_formulas() -> None:
    hostile = "<script>alert(1)</script>$x"
    given = finding("named") | PLAIN
    given["runs"][0] = hostile
    text = finding_page(given)
    assert "<script" not in text
    assert (
        text.count("&lt;script&gt;alert(1)&lt;/script&gt;$x") >= 3
    )  # in the list, in a picture and in its table


def test_a_value_that_a_template_wants_and_does_not_get_is_an_error() -> None:
    with pytest.raises(UndefinedError, match="verdict"):
        page("finding.html")
