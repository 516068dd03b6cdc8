# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The search on rovers with two axles, and with the bogie in front."""

import pytest
import torch

from terrain_estimator.discovery.hypotheses.library import singles
from terrain_estimator.discovery.locate.where import disagreements, row_words
from terrain_estimator.discovery.next_drive.missing_signals import (
    BOGIE_ANGLE,
    lacking,
    with_signal,
    without_signals,
)
from terrain_estimator.discovery.runs import cut
from terrain_estimator.model.packing import view_of
from terramechanics.vehicle.rover import Rover
from tests.rovers import BOGIE_IN_FRONT, FOUR_WHEELS
from tests.terrain_estimator.discovery.known import SIZES, drives, study

KINDS = pytest.mark.parametrize("rover", [FOUR_WHEELS, BOGIE_IN_FRONT], ids=lambda each: each.name)


@KINDS
def test_the_drag_of_the_drives_is_the_likeliest_of_what_may_be_missing(rover: Rover) -> None:
    every = singles(("drive_drag", "slope_bias", "failed_wheel"), rover.axles)
    assert len(every) == 2 + rover.axles
    known = study("drive_drag", rover=rover)
    with torch.inference_mode():
        found = max((known.explain(each) for each in every), key=lambda each: each.fit.log_evidence)
    assert found.hypothesis.names == ("drive_drag",)
    assert found.fit.log_evidence > known.nothing.fit.log_evidence + 20.0
    _, size, deviation = found.sizes[0]
    assert abs(size - SIZES["drive_drag"]) < 4.0 * deviation


def test_rows_of_two_axles_have_the_names_of_front_and_rear() -> None:
    four, six = (study("", rover=rover).nominal for rover in (FOUR_WHEELS, BOGIE_IN_FRONT))
    assert row_words("torque_1", four) == "torque row of the rear wheels"
    assert row_words("torque_1", six) == "torque row of the middle wheels"


def test_a_tilted_attitude_sensor_shows_in_the_velocity_row_of_four_wheels() -> None:
    with torch.inference_mode():
        found = disagreements(study("slope_bias", rover=FOUR_WHEELS))
    assert [each.row for each in found] == ["velocity"]


@KINDS
def test_only_a_bogie_has_an_angle_to_miss(rover: Rover) -> None:
    known = study("", rover=rover)
    assert lacking(known.runs) == ()
    run = drives("", rover)[0]
    blind = cut(without_signals(run, (BOGIE_ANGLE,), rover.axles), known.nominal.contact)
    if not rover.suspension:
        return
    assert lacking([blind]) == (BOGIE_ANGLE,)
    view = view_of(blind.packed, rover.axles)
    seen = with_signal(blind, BOGIE_ANGLE, rover, view.torque)
    angle = view_of(seen.packed, rover.axles).bogie_angle
    torch.testing.assert_close(
        angle, 0.5 * (view.contact_angle[..., 0] + view.contact_angle[..., 1])
    )
