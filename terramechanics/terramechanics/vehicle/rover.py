# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rover: mass, wheels, and its suspension by axles and passive joints."""

from dataclasses import asdict, dataclass, fields
from itertools import pairwise
from typing import Any, TypeVar

from rover_parameters.records import ConfigError, entry, number

Values = TypeVar("Values", bound=Any)
"""Tensors or arrays: nodes compute without torch."""


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
class Joint:
    """A passive joint: a bogie that turns freely about its pivot on the body."""

    axles: tuple[int, int] = number(
        "the two neighbouring axles that it carries, counted from the front", "1", 0
    )
    x: float = number("place of the pivot along the body", "m")
    height: float = number("height of the pivot", "m", 0.0)


SHORT_FORM = ("bogie_pivot_x", "bogie_pivot_height")
"""Keys that stand for one joint, which carries the middle and the rear axle."""
LEAST_APART, FARTHEST = 0.01, 100.0
"""[m] Least distance of two axles, and farthest place of one: beyond, a unit is wrong."""
MOST_JOINTS = 1
"""More are not estimated: an observation holds the angle of one."""
LEAST_BEARING = 2
"""Fewest axles and pivots that bear a body: with fewer it falls, with a joint more it folds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rover:
    """A rover, by its axles and passive joints.

    The body carries the axles that no joint carries. With two joints fewer than axles every wheel
    touches the ground and, where left and right move alike, loads follow from the balances alone:

    - two axles and no joint: four wheels on a rigid body;
    - three axles and one joint: six wheels, two axles of them on a bogie in front or behind.

    So such a rover may be planar: one wheel stands for ``wheels_per_axle``, and the rocker is the
    body. With more axles the loads depend on the stiffness of chassis and ground as well, and every
    wheel is one of its own (``chassis``).

    x points forward from the middle of the body; heights are above the ground on which the wheels
    stand unsunk. Raises ConfigError where the values do not fit together.
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
    axle_x: tuple[float, ...] = number("place of the axles along the body, front to rear", "m")
    centre_of_mass_x: float = number("place of the centre of mass along the body", "m")
    centre_of_mass_height: float = number("height of the centre of mass", "m", 0.0)
    bogie_pivot_x: float | None = number(
        "short form of a joint with the middle and rear axle: its place", "m", default=None
    )
    bogie_pivot_height: float | None = number("height of that joint", "m", 0.0, default=None)
    joints: tuple[Joint, ...] = entry("every passive joint", ())
    differential: bool = entry(
        "whether a differential bears the body on rockers left and right; false: both are fixed to"
        " the body",
        default=True,
    )
    cruise_speed: tuple[float, float] = number(
        "lowest and highest speed of the random drives", "m/s", 0.0, exclusive=True
    )
    sinkage_noise_floor: float = number(
        "constant part of the sinkage measurement's standard deviation", "m", 0.0
    )
    wheels: tuple[Wheel, ...] = entry("every wheel by name")

    def __post_init__(self) -> None:
        if not all(ahead > behind for ahead, behind in pairwise(self.axle_x)):
            raise ConfigError(f"axle_x {list(self.axle_x)} must fall from front to rear")
        for index, (ahead, behind) in enumerate(pairwise(self.axle_x)):
            if ahead - behind < LEAST_APART or max(ahead, -behind) > FARTHEST:
                raise ConfigError(
                    f"axle_x: axles {index} and {index + 1} are at {ahead:g} and {behind:g} m: they"
                    f" must be {LEAST_APART:g} m apart or more, within {FARTHEST:g} m; is the unit"
                    " m?"
                )
        self._check_joints()
        wheelbase = self.axle_x[0] - self.axle_x[-1]
        if self.wheel_radius > wheelbase:
            raise ConfigError(
                f"wheel_radius: {self.wheel_radius:g} m is more than the {wheelbase:g} m from the"
                " first axle to the last: correct one of them; is the unit m?"
            )
        if self.cruise_speed[0] > self.cruise_speed[1]:
            raise ConfigError(f"cruise_speed {list(self.cruise_speed)} must not fall")
        self._check_wheels()
        self._check_centre()

    def _check_joints(self) -> None:
        given = [getattr(self, name) is not None for name in SHORT_FORM]
        if any(given) and (not all(given) or self.joints):
            raise ConfigError(
                f"{' and '.join(SHORT_FORM)} are one joint together: give both, or joints instead"
            )
        if all(given) and self.axles != len(("front", "middle", "rear")):
            raise ConfigError(
                f"bogie_pivot_x is the pivot of a bogie with the middle and rear of three axles,"
                f" axle_x has {self.axles}: leave it out, or give joints"
            )
        joints = len(self.suspension)
        if joints > MOST_JOINTS:
            raise ConfigError(
                f"joints: {joints} are given, at most {MOST_JOINTS} is supported: an observation"
                " holds the angle of one"
            )
        if self.axles < joints + LEAST_BEARING:
            raise ConfigError(
                f"axle_x has {self.axles} {'axle' if self.axles == 1 else 'axles'} and joints"
                f" {joints}: the body needs {LEAST_BEARING} axles, and one more for a joint, or it"
                " falls or folds"
            )
        if not (self.differential or joints):
            raise ConfigError(
                "differential false: without a joint there are no rockers to bear on one: leave it"
                " out"
            )
        for index, joint in enumerate(self.suspension):
            self._check_joint(f"joints[{index}]", joint)

    def _check_joint(self, name: str, joint: Joint) -> None:
        first, second = joint.axles
        if second != first + 1 or second >= self.axles:
            raise ConfigError(
                f"{name}: axles {list(joint.axles)} are not two neighbours of the {self.axles}"
                " axles, counted from 0 at the front"
            )
        if not self.axle_x[first] > joint.x > self.axle_x[second]:
            raise ConfigError(
                f"{f'{name}: x' if self.joints else 'bogie_pivot_x'} {joint.x:g} m must lie between"
                f" its axles, {self.axle_x[second]:g} and {self.axle_x[first]:g} m"
            )

    def _check_centre(self) -> None:
        """Raise ConfigError where an axle lifts on level ground."""
        on_body = [x for axle, x in enumerate(self.axle_x) if not self.is_on_joint(axle)]
        bearing = [*on_body, *(joint.x for joint in self.suspension)]
        rear, front = min(bearing), max(bearing)
        if not rear < self.centre_of_mass_x < front:
            raise ConfigError(
                f"centre_of_mass_x {self.centre_of_mass_x:g} m: the rover tips over; it must lie"
                f" between what carries the body, {rear:g} and {front:g} m"
            )

    def _check_wheels(self) -> None:
        names = [wheel.name for wheel in self.wheels]
        if len(set(names)) < len(names):
            raise ConfigError(f"wheels: the names {names} are not all different")
        for wheel in self.wheels:
            if wheel.axle >= self.axles:
                raise ConfigError(
                    f"wheel {wheel.name}: axle {wheel.axle}: axle_x has axles 0 to {self.axles - 1}"
                )
        counts = [
            sum(wheel.axle == axle for wheel in self.wheels) for axle in range(len(self.axle_x))
        ]
        if len(set(counts)) > 1 or counts[0] == 0:
            raise ConfigError(
                f"wheels: every one of the {len(counts)} axles needs the same number of wheels, got"
                f" {counts}"
            )

    def first_difference(self, other: "Rover") -> tuple[str, Any, Any] | None:
        """Return the first field in which another rover differs, and both values.

        Names count for nothing, nor does the order of the wheels. None where the rovers are alike.
        """
        for each in fields(self):
            values = getattr(self, each.name), getattr(other, each.name)
            if each.name in SHORT_FORM:
                continue
            if each.name == "joints":
                values = self.suspension, other.suspension
            if each.name == "wheels":
                values = sorted(self.wheel_axle), sorted(other.wheel_axle)
            if each.name != "name" and values[0] != values[1]:
                return each.name, *values
        return None

    def other_side(self, other: "Rover") -> tuple[str, Any, Any] | None:
        """Return the first wheel of a name of both that is on another side, with both sides.

        ``first_difference`` leaves sides out: they count where every wheel is one of its own.
        """
        sides = {wheel.name: wheel.side for wheel in other.wheels}
        for wheel in self.wheels:
            if (side := sides.get(wheel.name, wheel.side)) != wheel.side:
                return f"side of wheel {wheel.name}", wheel.side, side
        return None

    def content(self) -> dict[str, Any]:
        """Return the keys and values of the rover file, without those that were left out."""
        left_out = {each.name for each in fields(self) if getattr(self, each.name) == each.default}
        return {key: value for key, value in asdict(self).items() if key not in left_out}

    def record(self) -> dict[str, Any]:
        """Return every key and value, by which files recognise a rover.

        A key that is younger than such files is left out where it has its default.
        """
        younger = {} if self.differential else {"differential": False}
        every = asdict(self)
        del every["differential"]
        return every | younger

    def check_planar(self) -> None:
        """Raise ConfigError where the loads of a planar rover do not follow from its balances."""
        if not self.is_determined:
            raise ConfigError(
                f"{self.name}: axle_x has {self.axles} axles and joints {len(self.suspension)}: the"
                f" loads of a model by axle follow from balances, with {LEAST_BEARING} joints fewer"
                " than axles; make a model by wheel: ros2 run terrain_estimator model_by_wheel"
                " --rover FILE --soil SOIL... --track-width M; simulate with the parameter steering"
            )

    @property
    def suspension(self) -> tuple[Joint, ...]:
        """The passive joints, whichever form the rover file has."""
        if self.bogie_pivot_x is None or self.bogie_pivot_height is None:
            return self.joints
        return (Joint((1, 2), self.bogie_pivot_x, self.bogie_pivot_height),)

    @property
    def is_determined(self) -> bool:
        """Whether balances determine the loads where left and right move alike."""
        return self.axles == len(self.suspension) + LEAST_BEARING

    def is_on_joint(self, axle: int) -> bool:
        """Return whether a joint carries the axle; else the body does."""
        return any(axle in joint.axles for joint in self.suspension)

    @property
    def axles(self) -> int:
        """Number of axles."""
        return len(self.axle_x)

    @property
    def wheels_per_axle(self) -> int:
        """Number of wheels on one axle, for which one planar wheel stands."""
        return len(self.wheels) // self.axles

    @property
    def reach(self) -> float:
        """Distance of the furthest axle from the body's origin [m]."""
        return max(map(abs, self.axle_x))

    @property
    def weight(self) -> float:
        """Weight m g of the whole rover [N]."""
        return self.mass * self.gravity

    def slip(self, velocity: Values, rate: Values) -> Values:
        """Return slip 1 - v / (r w) at wheel rates w [rad/s] and velocities v [m/s], broadcast.

        Both are tensors or both arrays.
        """
        return 1.0 - velocity / (self.wheel_radius * rate)

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the wheels in the order of the rover file."""
        return tuple(wheel.name for wheel in self.wheels)

    @property
    def wheel_axle(self) -> tuple[int, ...]:
        """Axle of every wheel, in the order of wheel_names."""
        return tuple(wheel.axle for wheel in self.wheels)
