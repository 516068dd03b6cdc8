# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The simulated rover as plain NumPy loops over rovers, steps and wheels with SciPy's solvers.

Written from the equations alone, independent of terramechanics: the reference of its speed and a
check of its numbers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from terramechanics.vehicle.rover import Rover

Floats: TypeAlias = NDArray[np.float64]
POINTS = 12
"""Quadrature nodes in front of the largest stress and behind it, as in the simulation."""
LONG_STEP = 1e3
"""[s] Duration after which a rover is in its steady state."""
RANGE = (-0.6, 0.95)
"""[1] Slips of the contact model; the forces beyond are those at its ends."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(POINTS)


@dataclass(frozen=True, slots=True)
class NumpyTrack:
    """One rover's homogeneous ground, of slope(x) = mean + SUM a_j cos(k_j x + p_j)."""

    mean: float
    amplitude: Floats  # [sines] [1]
    wavenumber: Floats  # [sines] [rad/m]
    phase: Floats  # [sines] [rad]
    soil: Floats  # n [1], k_c [Pa/m^(n-1)], k_phi [Pa/m^n], K [m], c1 [1], c2 [1]
    strength: Floats  # c [Pa], tan phi [1]

    def height(self, x: Floats) -> Floats:
        """Return the height [m] at the places ``x`` [n] [m]."""
        waves = np.sin(np.outer(x, self.wavenumber) + self.phase)
        return self.mean * x + waves @ (self.amplitude / self.wavenumber)

    def angle(self, x: Floats) -> Floats:
        """Return the angle of the slope [rad] at the places ``x`` [n] [m]."""
        return np.arctan(
            self.mean + np.cos(np.outer(x, self.wavenumber) + self.phase) @ self.amplitude
        )


@dataclass(frozen=True, slots=True)
class NumpyPose:
    """Pose of a rover on the ground."""

    height: float  # [m]
    pitch: float  # [rad] nose-up
    bogie: float  # [rad] nose-up, relative to the body
    contact: Floats  # [3] [m] horizontal places of the wheels' contacts
    angle: Floats  # [3] [rad] of the ground there relative to the body
    axle: Floats  # [3, 2] [m] in the body frame


def wheel_forces(rover: Rover, track: NumpyTrack, slip: float, sinkage: float) -> Floats:
    """Return N, T [N] and M [N m] of one wheel by Wong and Reece's stresses.

    They are integrated in front of the largest stress and behind it.
    """
    n, k_c, k_phi, shear_modulus, c1, c2 = track.soil
    cohesion, tan_phi = track.strength
    radius, width = rover.wheel_radius, rover.wheel_width
    entry = np.arccos(1.0 - sinkage / radius)
    largest = entry * (c1 + c2 * slip)
    forces = np.zeros(3)

    def front(u: Floats) -> Floats:
        return entry - (entry - largest) * u**2

    def rear(u: Floats) -> Floats:
        return largest * u**2

    for theta_of, length in ((front, entry - largest), (rear, largest)):

        def displacement(u: Floats, theta_of: Callable[[Floats], Floats] = theta_of) -> Floats:
            theta = theta_of(u)
            return radius * (entry - theta - (1.0 - slip) * (np.sin(entry) - np.sin(theta)))

        for low, high in _panels(displacement, braked=slip < 0.0):
            u = low + (high - low) * (_NODES + 1.0) / 2.0
            theta, moved = theta_of(u), displacement(u)
            stress = (k_c / width + k_phi) * (radius * (np.cos(front(u)) - np.cos(entry))) ** n
            shear = (
                (cohesion + stress * tan_phi)
                * np.sign(moved)
                * (1.0 - np.exp(-np.abs(moved) / shear_modulus))
            )
            step = radius * width * length * (high - low) * u * _WEIGHTS
            forces[0] += step @ (stress * np.cos(theta) + shear * np.sin(theta))
            forces[1] += step @ (shear * np.cos(theta) - stress * np.sin(theta))
            forces[2] += radius * (step @ shear)
    return forces


def _panels(displacement: Callable[[Floats], Floats], *, braked: bool) -> list[tuple[float, float]]:
    """Return [0, 1], split at the kink where the shear displacement changes its sign."""
    ends = displacement(np.array([1e-6, 1.0])) if braked else np.ones(2)
    if ends[0] * ends[1] >= 0.0:
        return [(0.0, 1.0)]
    kink = optimize.brentq(lambda u: float(displacement(np.array([u]))[0]), 1e-6, 1.0, xtol=1e-15)
    return [(0.0, kink), (kink, 1.0)]


def stand(rover: Rover, track: NumpyTrack, x: float, start: NumpyPose | None = None) -> NumpyPose:
    """Return the pose in which the three wheels touch the ground, body at ``x`` [m]."""
    if start is None:
        start = NumpyPose(0.0, 0.0, 0.0, x + np.array(rover.axle_x), np.zeros(3), np.zeros((3, 2)))
    radius = rover.wheel_radius

    def gap(unknown: Floats) -> Floats:
        (height, pitch, bogie), contact = unknown[:3], unknown[3:]
        place = axles(rover, bogie)
        along = x + place[:, 0] * np.cos(pitch) - place[:, 1] * np.sin(pitch)
        up = height + place[:, 0] * np.sin(pitch) + place[:, 1] * np.cos(pitch)
        angle = track.angle(contact)
        return np.concatenate(
            [
                contact - radius * np.sin(angle) - along,
                track.height(contact) + radius * np.cos(angle) - up,
            ]
        )

    known = np.array([start.height, start.pitch, start.bogie])
    found = _solve(gap, np.concatenate([known, start.contact]))
    height, pitch, bogie = found[:3]
    return NumpyPose(
        height, pitch, bogie, found[3:], track.angle(found[3:]) - pitch, axles(rover, bogie)
    )


def axles(rover: Rover, bogie: float) -> Floats:
    """Return the axles in the body frame [3, 2] [m]; the rear two turn with the bogie."""
    pivot = np.array([rover.bogie_pivot_x, rover.bogie_pivot_height])
    turn = np.array([[np.cos(bogie), -np.sin(bogie)], [np.sin(bogie), np.cos(bogie)]])
    flat = np.array([[x, rover.wheel_radius] for x in rover.axle_x])
    return np.array([flat[0], *(pivot + turn @ (place - pivot) for place in flat[1:])])


def imbalance(rover: Rover, pose: NumpyPose, forces: Floats, acceleration: float) -> Floats:
    """Return the residuals of the equations of motion [4].

    Forces along and across the body [N], moments about its centre of mass and about the bogie's
    pivot [N m]. ``forces`` [3, 3] are N, T, M of one wheel of each axle.
    """
    centre = np.array([rover.centre_of_mass_x, rover.centre_of_mass_height])
    pivot = np.array([rover.bogie_pivot_x, rover.bogie_pivot_height])
    total = np.array([0.0, 0.0, 0.0, 0.0])
    for axle, ((normal, traction, torque), angle, place) in enumerate(
        zip(forces, pose.angle, pose.axle, strict=True)
    ):
        along = traction * np.cos(angle) - normal * np.sin(angle)
        up = normal * np.cos(angle) + traction * np.sin(angle)
        arm, lever = place - centre, place - pivot
        bogie = lever[0] * up - lever[1] * along + torque if axle > 0 else 0.0
        total += rover.wheels_per_axle * np.array(
            [along, up, arm[0] * up - arm[1] * along + torque, bogie]
        )
    weight = rover.mass * rover.gravity
    total[0] -= rover.mass * acceleration + weight * np.sin(pose.pitch)
    total[1] -= weight * np.cos(pose.pitch)
    return total


@dataclass(slots=True)
class State:
    """State of one rover between two steps."""

    position: float  # [m]
    velocity: float  # [m/s]
    rate: Floats  # [3] [rad/s] of the wheels
    sinkage: Floats  # [3] [m]
    pose: NumpyPose


def move(
    rover: Rover, track: NumpyTrack, state: State, rate: Floats, duration: float
) -> tuple[Floats, Floats, float, Floats]:
    """Return slips, sinkages [3], end velocity and forces [3, 3] of an implicit step."""
    unit = rover.wheel_radius * float(np.mean(rate))

    def contacts(unknown: Floats) -> tuple[Floats, Floats, Floats]:
        slip = np.clip(1.0 - unknown[3] * unit / (rover.wheel_radius * rate), *RANGE)
        sinkage = np.clip(np.exp(unknown[:3]), 0.0, 0.95 * rover.wheel_radius)
        return (
            slip,
            sinkage,
            np.array(
                [wheel_forces(rover, track, *each) for each in zip(slip, sinkage, strict=True)]
            ),
        )

    def residual(unknown: Floats) -> Floats:
        acceleration = (unknown[3] * unit - state.velocity) / duration
        return imbalance(rover, state.pose, contacts(unknown)[2], acceleration) / (
            rover.mass * rover.gravity
        )

    found = _solve(residual, np.append(np.log(state.sinkage), state.velocity / unit))
    slip, sinkage, forces = contacts(found)
    return slip, sinkage, max(float(found[3]) * unit, 0.0), forces


def drive(
    rover: Rover, track: NumpyTrack, start_velocity: float, commands: Floats, time_step: float
) -> dict[str, Floats]:
    """Simulate one drive under the wheel rates ``commands`` [1 + steps, 3].

    It starts from the steady state of the first. Returns series by name [steps, ...].
    """
    state = State(
        0.0,
        start_velocity,
        commands[0],
        np.full(3, 0.05 * rover.wheel_radius),
        stand(rover, track, 0.0),
    )
    _, state.sinkage, state.velocity, _ = move(rover, track, state, commands[0], LONG_STEP)
    series: dict[str, list[Floats | float]] = {
        name: [] for name in ("position", "velocity", "pitch", "slip", "sinkage", "torque")
    }
    for rate in commands[1:]:
        state.position += time_step * state.velocity * np.cos(state.pose.pitch)
        state.pose = stand(rover, track, state.position, state.pose)
        slip, state.sinkage, state.velocity, forces = move(rover, track, state, rate, time_step)
        torque = forces[:, 2] + rover.wheel_inertia * (rate - state.rate) / time_step
        state.rate = rate
        values = (state.position, state.velocity, state.pose.pitch, slip, state.sinkage, torque)
        for name, value in zip(series, values, strict=True):
            series[name].append(value)
    return {name: np.array(values) for name, values in series.items()}


def _solve(function: Callable[[Floats], Floats], start: Floats) -> Floats:
    found = optimize.root(function, start, method="hybr", options={"xtol": 1e-12})
    if np.abs(function(found.x)).max() > 1e-8:
        raise ArithmeticError(f"no solution from {start}: {found.message}")
    return found.x


def fleet(
    rover: Rover,
    tracks: Sequence[NumpyTrack],
    start_velocity: Floats,
    commands: Floats,
    time_step: float,
) -> list[dict[str, Floats]]:
    """Simulate every rover by itself.

    ``start_velocity`` is [rovers] [m/s], ``commands`` [rovers, 1 + steps, 3] [rad/s].
    """
    return [
        drive(rover, *each, time_step)
        for each in zip(tracks, start_velocity.tolist(), commands, strict=True)
    ]
