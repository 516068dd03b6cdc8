# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Integrals and forces that are remembered are those that would be computed; memory is bounded."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from terrain_estimator.discovery.hypotheses import rows
from terrain_estimator.discovery.hypotheses.library import Hypothesis, LibraryEffect
from terrain_estimator.discovery.hypotheses.rows import (
    HypothesisRows,
    LinearizationPoint,
    RememberedIntegrals,
    nominal_of,
)
from terrain_estimator.model.rows import Forces
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import ContactInputs
from terramechanics.terrain.soil import WONG_REECE
from tests.terrain_estimator.discovery.known import study

CONTACT = nominal_of(load_rover("mars_rover"), load_soil("loose_sand")).contact


def inputs(slip: float) -> ContactInputs:
    ones = torch.ones(50, 3, dtype=torch.float64)
    strength: Tensor = torch.tensor([1.0, 1.0], dtype=torch.float64)
    return ContactInputs(slip * ones, 0.01 * ones, CONTACT.constants, strength)


def test_equal_inputs_are_integrated_once(monkeypatch: pytest.MonkeyPatch) -> None:
    computed, slips = vars(rows)["_integrated"], list[float]()

    def counted(given: ContactInputs, contact: object, law: str) -> Tensor:
        slips.append(float(given.slip[0, 0]))
        found: Tensor = computed(given, contact, law)
        return found

    monkeypatch.setattr(rows, "_integrated", counted)
    remembered = RememberedIntegrals()
    found = [remembered(inputs(slip), CONTACT) for slip in (0.1, 0.2, 0.1, 0.2)]
    assert slips == [0.1, 0.2]
    for one, slip in zip(found, (0.1, 0.2, 0.1, 0.2), strict=True):
        assert torch.equal(one, computed(inputs(slip), CONTACT, WONG_REECE))
    other = CONTACT._replace(width=2.0 * CONTACT.width)
    assert not torch.equal(remembered(inputs(0.1), other), found[0])
    assert len(slips) == 3


def test_the_oldest_integrals_are_forgotten_first(monkeypatch: pytest.MonkeyPatch) -> None:
    size = RememberedIntegrals()(inputs(0.1), CONTACT).nbytes
    monkeypatch.setattr(rows, "REMEMBERED", 2 * size)
    computed, count = vars(rows)["_integrated"], [0]

    def counted(given: ContactInputs, contact: object, law: str) -> Tensor:
        count[0] += 1
        found: Tensor = computed(given, contact, law)
        return found

    monkeypatch.setattr(rows, "_integrated", counted)
    remembered = RememberedIntegrals()
    for slip in (0.1, 0.2, 0.3, 0.3, 0.2, 0.1):
        remembered(inputs(slip), CONTACT)
    assert count[0] == 4


def test_forces_that_no_effect_changes_are_read_once_and_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = study("").runs[0]
    nominal = study("").nominal
    pair = Hypothesis((LibraryEffect("failed_wheel", 0), LibraryEffect("payload")))
    point = LinearizationPoint(
        torch.tensor([2.0, 0.6], dtype=torch.float64),
        torch.zeros(nominal.uncertain.shape[0], dtype=torch.float64),
        (0.2, *(1.0 for _ in range(pair.effects[1].count))),
    )
    heavier, failing = (
        replace(point, values=tuple(v + each * (k == at) for k, v in enumerate(point.values)))
        for at, each in ((1, 2.0), (0, 0.1))
    )
    read, count = vars(rows)["read_forces"], [0]

    def counted(*given: object) -> Forces:
        count[0] += 1
        found: Forces = read(*given)
        return found

    monkeypatch.setattr(rows, "read_forces", counted)
    with torch.inference_mode():
        one = HypothesisRows(nominal, run, pair.laws(nominal.rover))
        around = one.expansion(point, torch.ones(len(nominal.row_names), dtype=torch.float64))
        one.rows(point, around)
        for moved, more in ((heavier, 0), (failing, 1)):
            before = count[0]
            found = one.rows(moved, around)
            assert count[0] == before + more
            anew = HypothesisRows(nominal, run, pair.laws(nominal.rover)).rows(moved, around)
            for each, expected in zip(found, anew, strict=True):
                assert torch.equal(each, expected)
