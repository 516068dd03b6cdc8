# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rover: mass, wheels, and the geometry of its rocker-bogie suspension."""

from dataclasses import dataclass

from rover_parameters.records import ConfigError, entry, number


@dataclass(frozen=True, slots=True)
class Wheel:
    """One wheel: its name in messages, its axle (0 is the front), and its side."""

    name: str
    axle: int = number("axle, counted from the front", "1", 0)
    side: str = "left"

    def __post_init__(self) -> None:
        if self.side not in ("left", "right"):
            raise ConfigError(f"wheel {self.name}: side {self.side!r} is neither left nor right")


@dataclass(frozen=True, slots=True)
class Rover:
    """A planar rover with three axles.

    The body (rocker) carries the front wheels, a bogie the middle and rear ones.

    x points forward from the middle of the body; heights are above the ground on which the wheels
    stand unsunk. Left and right move alike, so that one wheel stands for ``wheels_per_axle`` and
    the rocker is the body.
    """

    name: str
    mass: float = number(
        "mass of the whole rover, all of it in the body", "kg", 0.0, exclusive=True
    )
    gravity: float = number("gravitational acceleration", "m/s^2", 0.0, exclusive=True)
    wheel_radius: float = number("radius of every wheel", "m", 0.0, exclusive=True)
    wheel_width: float = number("width of every wheel", "m", 0.0, exclusive=True)
    wheel_inertia: float = number(
        "moment of inertia of one wheel with its drive, about its axle", "kg m^2", 0.0
    )
    axle_x: tuple[float, float, float] = number(
        "place of the axles along the body, front to rear", "m"
    )
    centre_of_mass_x: float = number("place of the centre of mass along the body", "m")
    centre_of_mass_height: float = number("height of the centre of mass", "m", 0.0)
    bogie_pivot_x: float = number("place of the bogie's pivot along the body", "m")
    bogie_pivot_height: float = number("height of the bogie's pivot", "m", 0.0)
    cruise_speed: tuple[float, float] = number(
        "lowest and highest speed of the random drives", "m/s", 0.0, exclusive=True
    )
    sinkage_noise_floor: float = number(
        "constant part of the sinkage measurement's standard deviation", "m", 0.0
    )
    wheels: tuple[Wheel, ...] = entry("every wheel by name")

    def __post_init__(self) -> None:
        front, middle, rear = self.axle_x
        if not front > middle > rear:
            raise ConfigError(f"axle_x {list(self.axle_x)} must fall from front to rear")
        if not middle > self.bogie_pivot_x > rear:
            raise ConfigError(
                f"bogie_pivot_x {self.bogie_pivot_x:g} must lie between the middle and the rear"
                " axle"
            )
        if self.cruise_speed[0] > self.cruise_speed[1]:
            raise ConfigError(f"cruise_speed {list(self.cruise_speed)} must not fall")
        self._check_wheels()

    def _check_wheels(self) -> None:
        names = [wheel.name for wheel in self.wheels]
        if len(set(names)) < len(names):
            raise ConfigError(f"wheels: the names {names} are not all different")
        counts = [
            sum(wheel.axle == axle for wheel in self.wheels) for axle in range(len(self.axle_x))
        ]
        if sum(counts) != len(self.wheels) or len(set(counts)) > 1 or counts[0] == 0:
            raise ConfigError(
                f"wheels: every one of the {len(counts)} axles needs the same number of wheels, got"
                f" {counts}"
            )

    @property
    def axles(self) -> int:
        """Number of axles."""
        return len(self.axle_x)

    @property
    def wheels_per_axle(self) -> int:
        """Number of wheels on one axle, for which one planar wheel stands."""
        return len(self.wheels) // self.axles

    @property
    def weight(self) -> float:
        """Weight m g of the whole rover [N]."""
        return self.mass * self.gravity

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the wheels in the order of the rover file."""
        return tuple(wheel.name for wheel in self.wheels)

    @property
    def wheel_axle(self) -> tuple[int, ...]:
        """Axle of every wheel, in the order of wheel_names."""
        return tuple(wheel.axle for wheel in self.wheels)
