# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""``make foreign`` on one log, and the figures of drives with known answers."""

import json
from pathlib import Path

import numpy as np
import pytest

from studies.foreign import __main__ as foreign
from studies.foreign.drives import Driven
from studies.foreign.scores import score

T, B, Q = 100, 10, 8


def driven(z: float, *, identified: bool, error: float = 0.0) -> Driven:
    """Return a drive that ends ``z`` deviations off in c, its forecast off by ``error`` [m/s]."""
    generator = np.random.default_rng(int(10 * abs(z)))
    true = np.full(T, 0.1)
    velocity = true + 0.01 * generator.standard_normal(T)
    eye = np.tile(np.eye(Q), (B, 1, 1))
    residual = generator.standard_normal((B, Q))
    residual[:, 1] = 3.0
    return Driven(
        truth=np.array([1000.0, 0.6]),
        mean=np.array([1000.0 + 100.0 * z, 0.6]),
        deviation=np.array([100.0, 0.1]),
        inside_95=np.array([float(abs(z) < 1.96), 1.0]),
        identified=np.array(float(identified)),
        disagrees=np.array(float(not identified)),
        identified_at=np.full(T, float(identified)),
        z_at=np.tile([z, 0.0], (T, 1)),
        accepted=np.ones(T),
        velocity=velocity,
        true_velocity=true,
        innovation=velocity - (true + error),
        variance=np.full(T, 1e-4),
        taken=np.array([1.0] * 4 + [0.0] * 6),
        length=np.full(B, 10.0),
        residual=residual,
        noise=eye,
        leading=residual,
        spread=eye,
    )


def test_only_identified_drives_count_as_wrong() -> None:
    cases = [(0.5, True), (2.5, True), (4.0, True), (9.0, False)]
    found = score("m", list("abcd"), [driven(z, identified=known) for z, known in cases])
    assert found.far.value == pytest.approx(1 / 4)
    assert found.outside.value == pytest.approx(2 / 4)
    assert found.far_at.value == found.ever_far.value == pytest.approx(1 / 4)
    assert found.identified.value == pytest.approx(3 / 4)
    assert found.disagrees.value == pytest.approx(1 / 4)
    assert [each.z[0] for each in found.drives] == [0.5, 2.5, 4.0, 9.0]
    assert found.taken.value == pytest.approx(0.4)


def test_a_forecast_is_judged_beside_the_velocity_that_stays() -> None:
    right = score("m", ["a"], [driven(0.0, identified=True)])
    assert right.over_persistence.value == 0.0
    assert right.persistence == pytest.approx(0.01, rel=0.2)
    assert right.covered.value > 0.9
    wrong = score("m", ["a"], [driven(0.0, identified=True, error=0.05)])
    assert wrong.over_persistence.value == pytest.approx(0.05 / wrong.persistence)
    assert wrong.covered.value < 0.1


def test_an_offset_that_stays_shows_in_mean_and_correlation_of_its_row_alone() -> None:
    rows = score("m", ["a", "b"], [driven(z, identified=True) for z in (0.0, 1.0)]).rows
    assert rows[1].mean.value == pytest.approx(3.0)
    assert rows[1].deviation.value == pytest.approx(0.0, abs=1e-9)
    assert rows[1].correlation.value == pytest.approx(1.0)
    assert abs(rows[0].correlation.value) < 0.6


def test_the_study_writes_its_page_and_computes_nothing_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = [f"--{name}={tmp_path / file}" for name, file in _FILES.items()]
    assert foreign.main(["--log", "A_steep_tracks", *place]) == 0
    text = (tmp_path / "page.md").read_text()
    assert "A_steep_tracks" in text
    assert "next velocity in its 95 % interval" in text
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert [model["model"] for model in figures["models"]] == ["shipped", "control"]

    def no_drive(*_: object) -> Driven:
        raise AssertionError("a drive was computed again")

    monkeypatch.setattr(foreign, "study_drive", no_drive)
    assert foreign.main(["--log", "A_steep_tracks", *place]) == 0
    assert (tmp_path / "page.md").read_text() == text


_FILES = {"records": "records", "out": "figures.json", "table": "page.md"}
