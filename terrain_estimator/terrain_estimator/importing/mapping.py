# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Mapping of the columns of a CSV file to signals, units and noise."""

import dataclasses
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rover_parameters.records import ConfigError, nearest, number
from rover_parameters.yaml_files import load
from terrain_estimator.importing.units import factor
from terrain_estimator.topics import LOCAL, UNDISTURBED
from terramechanics.vehicle.rover import Rover

SLIP_DEFINITIONS = ("one_minus_v_over_rw", "max_normalised")
ANGLE_REFERENCES = ("body", "horizontal")
DECIMAL_MARKS = (".", ",")
WHEEL_SIGNALS = {
    "slip": "ratio",
    "sinkage": "length",
    "contact_angle": "angle",
    "wheel_rate": "wheel rate",
    "torque": "torque",
    "steering": "angle",
}
"""Signals with a column for each wheel, and their quantity."""
BODY_SIGNALS = {
    "velocity": "velocity",
    "pitch": "angle",
    "acceleration": "acceleration",
    "bogie_angle": "angle",
    "roll": "angle",
    "lateral_velocity": "velocity",
    "yaw_rate": "yaw rate",
}
"""Signals of the rover's body, and their quantity."""
SIGNED = ("pitch", "bogie_angle")
"""Signals whose positive direction has to be given."""
WITH_DEVIATION = (
    "slip",
    "sinkage",
    "contact_angle",
    "velocity",
    "pitch",
    "acceleration",
    "lateral_velocity",
    "yaw_rate",
)
"""Signals whose messages carry a standard deviation, so that their noise must be known."""


@dataclass(frozen=True)
class SignalNoise:
    """Standard deviation of a signal: ``hypot(relative |value|, absolute)``."""

    relative: float = number("fraction of the value", low=0.0, default=0.0)
    absolute: float = number("in the signal's own unit", low=0.0, default=0.0)


@dataclass(frozen=True)
class WheelColumns:
    """Columns of one wheel; empty where there is none."""

    name: str
    slip: str = ""
    sinkage: str = ""
    contact_angle: str = ""
    wheel_rate: str = ""
    torque: str = ""
    steering: str = ""


@dataclass(frozen=True)
class Time:
    """Column of the time of measurement."""

    column: str
    unit: str = "s"
    offset: float = number("added to every time", unit="s", default=0.0)

    def __post_init__(self) -> None:
        """Check the unit."""
        _check_unit("time", self.unit, "time")


@dataclass(frozen=True)
class WheelSignal:
    """Unit and noise of a signal that each wheel has; the wheels name its columns."""

    unit: str
    noise: SignalNoise = SignalNoise()


@dataclass(frozen=True)
class Constant:
    """A value that was not measured but is known, such as the slope of a level test bed."""

    unit: str
    value: float = number("in that unit")
    noise: SignalNoise = SignalNoise()


@dataclass(frozen=True)
class BodySignal:
    """Column, unit and noise of a signal of the rover's body.

    The column is empty where it was not measured.
    """

    column: str = ""
    unit: str = ""
    noise: SignalNoise = SignalNoise()
    positive: str = ""  # of pitch and bogie_angle: nose_up or nose_down


_NO_WHEEL_SIGNAL = WheelSignal("")
_NO_BODY_SIGNAL = BodySignal()
_NO_CONSTANT = Constant("", 0.0)


@dataclass(frozen=True)
class Mapping:
    """A whole mapping file.

    Raises ConfigError where units, noise or columns do not fit together.
    """

    time: Time
    wheels: tuple[WheelColumns, ...]
    slip_definition: str = SLIP_DEFINITIONS[0]
    contact_angle_reference: str = ANGLE_REFERENCES[0]
    sinkage_reference: str = UNDISTURBED
    delimiter: str = ","
    decimal: str = "."
    missing: tuple[str, ...] = ()  # words for values that were not measured
    frame: str = "base_link"
    slip: WheelSignal = _NO_WHEEL_SIGNAL
    sinkage: WheelSignal = _NO_WHEEL_SIGNAL
    contact_angle: WheelSignal = _NO_WHEEL_SIGNAL
    wheel_rate: WheelSignal = _NO_WHEEL_SIGNAL
    torque: WheelSignal = _NO_WHEEL_SIGNAL
    steering: WheelSignal = _NO_WHEEL_SIGNAL
    velocity: BodySignal = _NO_BODY_SIGNAL
    pitch: BodySignal = _NO_BODY_SIGNAL
    acceleration: BodySignal = _NO_BODY_SIGNAL
    bogie_angle: BodySignal = _NO_BODY_SIGNAL
    roll: BodySignal = _NO_BODY_SIGNAL
    lateral_velocity: BodySignal = _NO_BODY_SIGNAL
    yaw_rate: BodySignal = _NO_BODY_SIGNAL
    constant_contact_angle: Constant = _NO_CONSTANT
    constant_pitch: Constant = _NO_CONSTANT

    def __post_init__(self) -> None:
        """Check the fields against each other."""
        if self.slip_definition not in SLIP_DEFINITIONS:
            msg = (
                f"slip_definition: {self.slip_definition!r} is unknown: give one of"
                f" {', '.join(SLIP_DEFINITIONS)}"
            )
            raise ConfigError(msg)
        self._check_references()
        if len(self.delimiter) != 1:
            msg = f"delimiter: {self.delimiter!r} is not one character"
            raise ConfigError(msg)
        if self.decimal not in DECIMAL_MARKS:
            msg = f"decimal: {self.decimal!r} is no decimal mark: give {' or '.join(DECIMAL_MARKS)}"
            raise ConfigError(msg)
        if self.decimal == self.delimiter:
            msg = (
                f"decimal: {self.decimal!r} is also the delimiter: set delimiter to the character"
                ' between the columns, such as ";"'
            )
            raise ConfigError(msg)
        names = [wheel.name for wheel in self.wheels]
        if len(set(names)) < len(names):
            msg = f"wheels: a name is given twice in {', '.join(names)}"
            raise ConfigError(msg)
        for signal in WHEEL_SIGNALS:
            self._check_wheel_signal(signal)
        for signal in BODY_SIGNALS:
            self._check_body_signal(signal)
        for name, constant in (
            ("contact_angle", self.constant_contact_angle),
            ("pitch", self.constant_pitch),
        ):
            if constant is not _NO_CONSTANT:
                _check_constant(f"constant_{name}", constant, measured=self.measures(name))

    def completed(self, rover: Rover) -> "Mapping":
        """Return the mapping with all wheels of a rover; those not listed have no columns.

        Raises ConfigError for a wheel or a bogie that the rover does not have.
        """
        if self.measures("bogie_angle") and not rover.suspension:
            raise ConfigError(
                f"bogie_angle: the rover {rover.name} has no joint: leave it out, or give the"
                " rover's file with --rover"
            )
        listed = [wheel.name for wheel in self.wheels]
        for at, name in enumerate(listed):
            if name not in rover.wheel_names:
                raise ConfigError(
                    f"wheels[{at}]: name: {name!r} is no wheel of the rover {rover.name}:"
                    f" {nearest(name, rover.wheel_names)}; correct the name, or give the rover's"
                    " file with --rover"
                )
        rest = [WheelColumns(name) for name in rover.wheel_names if name not in listed]
        return dataclasses.replace(self, wheels=(*self.wheels, *rest))

    def columns(self, signal: str) -> tuple[str, ...]:
        """Return a wheel signal's columns in the order of the wheels, empty for none."""
        return tuple(getattr(wheel, signal) for wheel in self.wheels)

    def measures(self, signal: str) -> bool:
        """Return whether the file has a column of this signal."""
        return (
            any(self.columns(signal))
            if signal in WHEEL_SIGNALS
            else bool(getattr(self, signal).column)
        )

    def all_columns(self) -> Iterator[str]:
        """Yield the names of all columns that are needed."""
        yield self.time.column
        for wheel in self.wheels:
            yield from (column for column in dataclasses.astuple(wheel)[1:] if column)
        yield from (
            getattr(self, signal).column for signal in BODY_SIGNALS if getattr(self, signal).column
        )

    def _check_references(self) -> None:
        if self.sinkage_reference not in (UNDISTURBED, LOCAL):
            msg = (
                f"sinkage_reference: {self.sinkage_reference!r} is unknown: give {UNDISTURBED}, for"
                f" ground where no wheel has been, or {LOCAL}, for the ground right before the"
                " wheel"
            )
            raise ConfigError(msg)
        reference = self.contact_angle_reference
        if reference not in ANGLE_REFERENCES:
            msg = (
                f"contact_angle_reference: {reference!r} is unknown: give one of"
                f" {', '.join(ANGLE_REFERENCES)}"
            )
            raise ConfigError(msg)
        if (
            reference != "body"
            and not self.measures("pitch")
            and self.constant_pitch is _NO_CONSTANT
        ):
            msg = (
                f"contact_angle_reference: {reference} needs the pitch of the body: give pitch or"
                " constant_pitch"
            )
            raise ConfigError(msg)

    def _check_wheel_signal(self, name: str) -> None:
        signal: WheelSignal = getattr(self, name)
        if signal is _NO_WHEEL_SIGNAL:
            if self.measures(name):
                msg = (
                    f"{name}: the wheels have columns, but their unit is missing: add {name}:"
                    " {unit: ...}"
                )
                raise ConfigError(msg)
            return
        if not self.measures(name):
            msg = (
                f"{name}: no wheel has a column for it: add {name}: COLUMN to the wheels, or leave"
                " out the section"
            )
            raise ConfigError(msg)
        _check_signal(name, WHEEL_SIGNALS[name], signal)

    def _check_body_signal(self, name: str) -> None:
        signal: BodySignal = getattr(self, name)
        if signal is _NO_BODY_SIGNAL:
            return
        if not signal.column:
            msg = f"{name}: missing key 'column'"
            raise ConfigError(msg)
        _check_signal(name, BODY_SIGNALS[name], signal)
        signs = ("nose_up", "nose_down") if name in SIGNED else ("",)
        if signal.positive not in signs:
            msg = (
                f"{name}: positive: {signal.positive!r}, expected"
                f" {' or '.join(signs) or 'no such key'}"
            )
            raise ConfigError(msg)


def read_mapping(path: Path) -> Mapping:
    """Read a mapping file; a ConfigError names file, key and value."""
    mapping = load(Mapping, path)
    known: dict[str, tuple[str, str]] = {}
    # wheels may share a column, as with one sensor on an axle
    for column, signal, quantity in _named(mapping):
        first, of_first = known.setdefault(column, (signal, quantity))
        if of_first != quantity:
            raise ConfigError(
                f"{path}: column {column!r} is named for {first} and for {signal}: it can be only"
                " one of them"
            )
    return mapping


def _named(mapping: Mapping) -> Iterator[tuple[str, str, str]]:
    """Yield every column that is named, with its signal and quantity."""
    yield mapping.time.column, "time", "time"
    of_body = (
        (getattr(mapping, signal).column, signal, quantity)
        for signal, quantity in BODY_SIGNALS.items()
    )
    of_wheels = (
        (column, signal, quantity)
        for signal, quantity in WHEEL_SIGNALS.items()
        for column in mapping.columns(signal)
    )
    yield from (each for each in itertools.chain(of_body, of_wheels) if each[0])


def _check_signal(name: str, quantity: str, signal: WheelSignal | BodySignal) -> None:
    _check_unit(name, signal.unit, quantity)
    if name in WITH_DEVIATION and signal.noise == SignalNoise():
        msg = (
            f"{name}: its noise is missing: add noise: {{relative: ..., absolute: ...}}, at least"
            " one of them above 0"
        )
        raise ConfigError(msg)


def _check_constant(name: str, constant: Constant, *, measured: bool) -> None:
    _check_unit(name, constant.unit, "angle")
    if measured:
        msg = f"{name}: it is both a constant and a column: leave out one of the two"
        raise ConfigError(msg)
    if constant.noise == SignalNoise():
        msg = (
            f"{name}: its noise is missing: add noise: {{absolute: ...}} above 0, the uncertainty"
            " of the value"
        )
        raise ConfigError(msg)


def _check_unit(name: str, unit: str, quantity: str) -> None:
    try:
        factor(quantity, unit)
    except ValueError as error:
        msg = f"{name}: {error}"
        raise ConfigError(msg) from error
