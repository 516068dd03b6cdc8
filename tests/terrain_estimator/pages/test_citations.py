# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The sources of an estimate are cited in full."""

import re
from pathlib import Path

from terrain_estimator.model.metadata import MODELS, read_metadata
from terrain_estimator.pages.citations import citations

ROOT = Path(__file__).parents[3]
METADATA = read_metadata(MODELS / "mars_rover_with_net.json")


def test_the_literature_of_the_page_about_the_method_is_cited() -> None:
    page = (ROOT / "docs/method.md").read_text(encoding="utf-8")
    named = re.findall(r"[(:] ?([A-Z]\w+)(?:,? [\w]+)* (\d{4})\)", page)
    assert len(named) >= 4
    cited = list(citations(METADATA.rows, METADATA.parameters, []))
    for author, year in named:
        assert any(author in each and year in each for each in cited), f"{author} {year}"


def test_what_a_model_does_not_use_is_not_cited() -> None:
    everything = set(citations(METADATA.rows, METADATA.parameters, ["grousers"]))
    plain = set(citations(("velocity", "load"), ("cohesion_kpa", "tan_phi"), []))
    assert {each.split(",")[0].split(":")[0] for each in everything - plain} == {
        "K. Iagnemma",
        "J. Harrison",
        "T. J. Mitchell",
        "grousers",
    }
