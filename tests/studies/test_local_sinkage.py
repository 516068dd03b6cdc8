# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of local sinkages: equal drives for both, and what its lines count."""

import dataclasses
import re

import numpy as np
import pytest

from studies import local_sinkage
from studies.local_sinkage import REFERENCES, drawn, messages
from terrain_estimator.topics import LOCAL, UNDISTURBED


def test_both_sinkages_are_of_the_same_drive() -> None:
    [config] = drawn("mars_rover", 5, 1, by_wheel=False)
    found = {
        reference: list(messages(dataclasses.replace(config, sinkage_reference=reference), 1.0))
        for reference in REFERENCES
    }
    for (topic, one), (_, other) in zip(found[UNDISTURBED], found[LOCAL], strict=True):
        assert (str(one) == str(other)) == (topic != "wheel_sinkage")
    [turning] = drawn("four_wheel_rover", 5, 1, by_wheel=True)
    assert (turning.steering, turning.soil_overrides.n) == ("skid", config.soil_overrides.n)


def test_a_short_drive_is_judged(capsys: pytest.CaptureFixture[str]) -> None:
    given = ["--rover", "paper_rover", "--drives", "1", "--seconds", "3", "--seed", "4"]
    assert local_sinkage.main(given) == 0
    one, other, apart = capsys.readouterr().out.splitlines()
    assert one.startswith("undisturbed: intervals hold c ")
    assert other.startswith("local: intervals hold c ")
    figures = [float(each) for each in re.findall(r"[-+]?\d\.\d\d", apart)]
    assert len(figures) == 4
    # of one drive the root mean square is the magnitude
    assert np.abs(figures[:2]).tolist() == figures[2:]
