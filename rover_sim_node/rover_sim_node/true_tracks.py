# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""True sinkages from the ground right before each wheel, in the tracks of the wheels before it."""

import torch
from torch import Tensor

from rover_parameters.records import ConfigError
from rover_sim_node.config import LOCAL, SINKAGE_REFERENCES
from terramechanics.contact.tracks import Tracks
from terramechanics.vehicle.rover import Rover

_SPACING = 0.005
"""[m] Way of the fastest wheel between places that are remembered: a thousand are at most."""


class TrueTracks:
    """The tracks of a simulated rover, which has come straight to where it starts."""

    def __init__(self, rover: Rover, reach: float) -> None:
        """``reach`` [m] is the farthest that a wheel is from the middle of the ``rover``."""
        self._reach, self._width = reach, rover.wheel_width
        self._tracks: Tracks | None = None
        self._last = torch.zeros(())

    def local(self, places: Tensor, sinkage: Tensor, ahead: Tensor) -> Tensor:
        """Return sinkages [1, wheels] [m] from the ground right before the wheels.

        ``places`` [1, wheels, 2] [m] are theirs now, ``sinkage`` [1, wheels] [m] is from
        undisturbed ground, and ``ahead`` [1, 2] the direction in which the rover starts.
        """
        if self._tracks is None:
            back = -2.0 * self._reach * ahead
            self._tracks, self._last = Tracks(places, back, self._width, sinkage), places
        before = self._tracks.depth(places)
        if float((places - self._last).norm(dim=-1).max()) >= _SPACING:
            self._tracks.remember(places, torch.maximum(before, sinkage))
            self._last = places
        return sinkage - before


def tracks_of(reference: str, rover: Rover, reach: float) -> TrueTracks | None:
    """Return the tracks that a ``reference`` of the sinkage needs; None for undisturbed ground.

    Raises ConfigError for another one.
    """
    if reference not in SINKAGE_REFERENCES:
        raise ConfigError(
            f"parameter sinkage_reference: {reference!r} is unknown, give one of"
            f" {', '.join(SINKAGE_REFERENCES)}"
        )
    return TrueTracks(rover, reach) if reference == LOCAL else None
