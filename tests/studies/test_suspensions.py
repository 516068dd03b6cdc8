# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The study of rovers whose loads balances do not determine."""

import pytest

from studies.by_wheel.motions import HEAD, lines
from studies.by_wheel.suspensions import SUSPENSIONS, motions_of
from studies.off_plane import Kind
from terramechanics.presets import load_rover


@pytest.mark.parametrize("kind", SUSPENSIONS, ids=lambda kind: load_rover(kind.rover).name)
def test_a_line_counts_the_drives_of_such_a_rover(kind: Kind) -> None:
    every = motions_of(kind)
    assert len({each.words for each in every}) == len(every)
    (bumpy,) = (each for each in every if each.words.endswith("bumps of 5°"))
    (line,) = lines(kind, [bumpy], drives=2, samples=30)
    assert len(line) == len(HEAD)
    assert float(line[1].rstrip(" %")) > 90.0
    assert line[4].endswith(" of 2")


def test_the_rovers_are_of_kinds_that_others_are_not() -> None:
    six, eight, fixed = (load_rover(kind.rover) for kind in SUSPENSIONS)
    assert [six.axles, eight.axles] == [3, 4]
    for rigid in (six, eight):
        assert not rigid.is_determined
        assert not rigid.suspension
    mars = load_rover("mars_rover")
    assert fixed.first_difference(mars) == ("differential", False, True)
