# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Tracks: how many wheels rolled at a place before, straight ahead, beside, on turns."""

import math

import pytest
import torch
from torch import Tensor

from terramechanics.contact.tracks import LONGEST, Tracks

WHEELS = torch.tensor([[0.5, 0.4], [-0.5, 0.4], [0.5, -0.4], [-0.5, -0.4]], dtype=torch.float64)
WIDTH = 0.2
BACK = torch.tensor([[-1.0, 0.0]], dtype=torch.float64)


def at(x: float, y: float, heading: float = 0.0) -> Tensor:
    sine, cosine = math.sin(heading), math.cos(heading)
    turn = torch.tensor([[cosine, sine], [-sine, cosine]], dtype=torch.float64)
    return (WHEELS @ turn + torch.tensor([x, y], dtype=torch.float64)).unsqueeze(0)


def driven(*poses: tuple[float, float, float]) -> Tensor:
    """Return the passes at the last of these poses."""
    tracks = Tracks(at(*poses[0]), BACK, WIDTH)
    for pose in poses[1:-1]:
        tracks.remember(at(*pose))
    return tracks.passes(at(*poses[-1]))[0]


def test_straight_ahead_the_rear_wheels_follow_the_front_ones_from_the_start() -> None:
    expected = [0.0, 1.0, 0.0, 1.0]
    assert driven((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).tolist() == expected
    straight = [(0.03 * k, 0.0, 0.0) for k in range(60)]
    assert driven(*straight).tolist() == pytest.approx(expected)


def test_a_wheel_beside_a_track_counts_by_what_it_covers() -> None:
    """The rover crabs by half of a wheel's width between the front wheels and the rear ones."""
    ahead = [(0.05 * k, 0.0, 0.0) for k in range(30)]
    found = driven(*ahead, (1.5, 0.5 * WIDTH, 0.0))
    assert found.tolist() == pytest.approx([0.0, 0.5, 0.0, 0.5], abs=1e-9)
    assert driven(*ahead, (1.5, 1.1 * WIDTH, 0.0)).tolist() == [0.0] * 4


def test_in_a_turn_rear_wheels_run_beside_the_tracks() -> None:
    """On a circle of 0.8 m the rear wheels are on circles of their own, as the front ones are.

    The rover is symmetric, so that they are the same circles: all of it is tracks.
    """
    circle = [
        (0.8 * math.sin(0.05 * k), 0.8 * (1.0 - math.cos(0.05 * k)), 0.05 * k) for k in range(40)
    ]
    assert driven(*circle).tolist() == pytest.approx([0.0, 1.0, 0.0, 1.0], abs=0.02)
    spiral = [(0.02 * k, 0.03 * k * k / 40.0, 0.0) for k in range(40)]
    found = driven(*spiral)
    assert bool((found[[1, 3]] < 0.6).all())


def test_backing_out_front_wheels_roll_where_the_rear_ones_were() -> None:
    way = [*(0.05 * k for k in range(30)), *(0.05 * k for k in range(29, 5, -1))]
    found = driven(*((x, 0.0, 0.0) for x in way))
    assert found.tolist() == pytest.approx([1.0] * 4)


def test_a_rover_that_stands_keeps_its_tracks_and_one_that_went_on_leaves_them() -> None:
    tracks = Tracks(at(0.0, 0.0), BACK, WIDTH)
    for _ in range(500):
        tracks.remember(at(0.0, 0.0))
    assert len(tracks._trail) == 2
    for k in range(2000):
        tracks.remember(at(0.05 * k, 0.0))
    assert len(tracks._trail) < 80
    assert tracks.passes(at(100.0, 0.0))[0].tolist() == pytest.approx([0.0, 1.0, 0.0, 1.0])
    for k in range(3000):
        tracks.remember(at(100.0, 0.0, 0.05 * k))
    assert len(tracks._trail) <= LONGEST


def sunk(tracks: Tracks, pose: tuple[float, float, float], *depths: float) -> list[float]:
    """Return the depths before the wheels at a pose, which sink to ``depths`` [m]."""
    places = at(*pose)
    before = tracks.depth(places)
    tracks.remember(places, torch.maximum(before, torch.tensor([depths], dtype=torch.float64)))
    return before[0].tolist()


DEPTHS = (0.02, 0.03, 0.04, 0.01)
FRONT_BEFORE_REAR = [0.0, 0.02, 0.0, 0.04]


def sinking() -> Tracks:
    return Tracks(at(0.0, 0.0), BACK, WIDTH, torch.tensor([DEPTHS], dtype=torch.float64))


def test_a_wheel_behind_is_before_the_depth_that_the_one_ahead_left() -> None:
    tracks = sinking()
    for k in range(60):
        assert sunk(tracks, (0.03 * k, 0.0, 0.0), *DEPTHS) == pytest.approx(FRONT_BEFORE_REAR)


def test_the_ground_does_not_rise_behind_a_wheel_that_rides_higher() -> None:
    """A third row of wheels would be before the deeper of two: backing rolls over both."""
    tracks = sinking()
    for k in range(60):
        sunk(tracks, (0.03 * k, 0.0, 0.0), *DEPTHS)
    for k in range(40):
        found = sunk(tracks, (1.77 - 0.03 * k, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0)
        back = 0.03 * k
        if 0.0 < back < 1.0 - WIDTH or back > 1.0:  # between them the wheel is in part of a track
            assert found[::2] == pytest.approx([0.03 if back > 1.0 else 0.02, 0.04])
            assert found[1::2] == pytest.approx([0.03, 0.04])


@pytest.mark.parametrize("part", [0.3, 0.8])
def test_beside_a_track_its_depth_counts_by_what_is_covered(part: float) -> None:
    tracks = sinking()
    for k in range(60):
        sunk(tracks, (0.03 * k, 0.0, 0.0), *DEPTHS)
    found = tracks.depth(at(1.8, part * WIDTH))[0].tolist()
    assert found[1::2] == pytest.approx([(1.0 - part) * 0.02, (1.0 - part) * 0.04], rel=1e-6)


def test_places_that_are_forgotten_take_their_depths_along() -> None:
    tracks = sinking()
    deeper = [0.01 + 1e-5 * k for k in range(LONGEST + 50)]
    before = [sunk(tracks, (0.002 * k, 0.0, 0.0), *[each] * 4) for k, each in enumerate(deeper)]
    assert before[-1][1] == pytest.approx(deeper[-1 - 500], abs=2.5e-5)  # which is 1 m behind
