# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The terrain along a recorded track, from the rover's own attitude: an input of rollouts."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from scipy.interpolate import BSpline, make_smoothing_spline
from scipy.optimize import minimize_scalar
from torch import Tensor

from terrain_estimator.model.packing import view_of, with_contact_angle, with_pitch
from terramechanics.terrain.profile import Sampled
from terramechanics.vehicle.rover import Rover

BIN = 0.02
"""[m] Slopes measured in the same piece of the track are averaged."""
SPACING = 0.05
"""[m] of the profile's samples."""
SHARPEST = 0.3
"""[1] Largest curvature of the profile, in units of that of the wheels: sharper ones are noise."""
LEAST = 8
"""Pieces of the track that a spline needs."""


@dataclass(frozen=True, slots=True)
class SlopeTrack:
    """Slope of the ground along a track."""

    distance: Tensor  # [n] [m] of the body at every observation
    spline: BSpline  # slope [1] as a function of the distance [m]
    ends: tuple[float, float]  # [m] between which it is known


def track_of(packed: Tensor, rover: Rover) -> SlopeTrack:
    """Return the track of linked observations [n, P].

    A smoothing spline through the slopes below all wheels.

    How smooth it is follows from the slopes themselves (generalised cross-validation, Craven and
    Wahba 1979).
    """
    view = view_of(packed, rover.axles)
    angle = view.contact_angle
    moved = view.velocity * torch.cos(view.pitch) * view.step
    distance = torch.cumsum(moved, 0) - moved[0]
    steep = angle + view.pitch.unsqueeze(1)
    place = (
        distance.unsqueeze(1)
        + torch.tensor(rover.axle_x, dtype=torch.float64)
        + rover.wheel_radius * torch.sin(angle)
    )
    weight = 1.0 / (view.contact_angle_sd.square() + view.pitch_sd.square().unsqueeze(1))
    x, y, w = _binned(
        place.flatten().numpy(), torch.tan(steep).flatten().numpy(), weight.flatten().numpy()
    )
    return SlopeTrack(
        distance, _smooth(x, y, w, SHARPEST / rover.wheel_radius), (float(x[0]), float(x[-1]))
    )


def noisier(packed: Tensor, axles: int, generator: torch.Generator) -> Tensor:
    """Return the observations [n, P] with noise added to their angles."""
    view, count = view_of(packed, axles), len(packed)
    noise = torch.randn(count, axles, generator=generator, dtype=torch.float64)
    again = with_contact_angle(packed, view.contact_angle + view.contact_angle_sd * noise)
    tilt = torch.randn(count, 1, generator=generator, dtype=torch.float64).squeeze(1)
    return with_pitch(again, view.pitch + view.pitch_sd * tilt, axles)


def profile_of(track: SlopeTrack, origins: Tensor, length: float, rover: Rover) -> Sampled:
    """Return the profile of episodes from ``origins`` [batch] [m], ``length`` [m] at most."""
    reach = max(rover.axle_x) + 2.0 * rover.wheel_radius
    start = min(rover.axle_x) - 2.0 * rover.wheel_radius
    count = int((length + reach - start) / SPACING) + 2
    places = origins.unsqueeze(1) + start + SPACING * torch.arange(count, dtype=torch.float64)
    inside = places.clamp(*track.ends)
    slope = torch.from_numpy(track.spline(inside.numpy()))
    bend = torch.where(
        inside == places, torch.from_numpy(track.spline.derivative()(inside.numpy())), 0.0
    )
    return Sampled(slope, bend, start, SPACING)


def _binned(
    x: np.ndarray, y: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    width = max(min(BIN, (x.max() - x.min()) / (2 * LEAST)), 1e-6)
    number = np.floor((x - x.min()) / width).astype(np.intp)
    total = np.bincount(number, w)
    there = total > 0.0
    return (
        np.bincount(number, w * x)[there] / total[there],
        np.bincount(number, w * y)[there] / total[there],
        total[there],
    )


def _smooth(x: np.ndarray, y: np.ndarray, w: np.ndarray, sharpest: float) -> BSpline:
    """Return the spline of least cross-validation error.

    Smoother where it bends more sharply than wheels could follow.
    """
    return _smoothed(x.tobytes(), y.tobytes(), w.tobytes(), sharpest)


@lru_cache(maxsize=64)
def _smoothed(xs: bytes, ys: bytes, ws: bytes, sharpest: float) -> BSpline:
    """Return the spline; most effects leave the track as it is, so that two models share it."""
    x, y, w = map(np.frombuffer, (xs, ys, ws))
    spline, penalty = make_smoothing_spline(x, y, w, lam=_least_error(x, y, w)), 1e-6
    while np.abs(spline.derivative()(x)).max() > sharpest and penalty < 1e9:
        penalty *= 10.0
        spline = make_smoothing_spline(x, y, w, lam=penalty)
    return spline


def _least_error(x: np.ndarray, y: np.ndarray, w: np.ndarray) -> float:
    """Return the penalty whose spline has the least cross-validation error.

    As ``make_smoothing_spline`` finds it, but with the penalty as a diagonal matrix (Demmler and
    Reinsch 1975), for which one more penalty to try costs next to nothing.
    """
    count, h = len(x), np.diff(x)
    bends = np.zeros((count, count - 2))
    inner = np.arange(count - 2)
    bends[inner, inner], bends[inner + 2, inner] = 1.0 / h[:-1], 1.0 / h[1:]
    bends[inner + 1, inner] = -1.0 / h[:-1] - 1.0 / h[1:]
    gram = np.diag((h[:-1] + h[1:]) / 3.0) + np.diag(h[1:-1] / 6.0, 1) + np.diag(h[1:-1] / 6.0, -1)
    scaled = bends / np.sqrt(w)[:, None]
    sharpness, modes = np.linalg.eigh(scaled @ np.linalg.solve(gram, scaled.T))
    pulled, modes = modes.T @ (np.sqrt(w) * y), modes / np.sqrt(w)[:, None]

    def error(penalty: float) -> float:
        left = penalty * sharpness / (1.0 + penalty * sharpness)
        return float(((modes @ (left * pulled)) ** 2).sum() / left.sum() ** 2)

    return float(minimize_scalar(error, bounds=(0, count), method="bounded").x)
