# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Sinkages from undisturbed ground, from those that are measured from the track before a wheel.

A wheel in the track of a wheel ahead is below undisturbed ground by the depth of that track and its
own reading. The track is as deep as the deepest wheel that rolled there: ground does not rise
again. So of the last two lengths of the rover is kept where each wheel was and how deep it left the
ground, a value for a quarter of a wheel's radius. What was before is not known: a wheel has no
sinkage until it is where the front wheels began.

All is in the plane of the ground, in the frame of the body where the rover began, by the measured
motion of the body: wheels slip.
"""

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from terrain_estimator.estimator.off_plane import FASTEST, is_deviation
from terrain_estimator.estimator.saved_state import Arrays, StateFileError
from terrain_estimator.observation import Floats, Observation
from terramechanics.contact.trails import beside, covered, passed
from terramechanics.description.layout import wheel_sides
from terramechanics.vehicle.rover import Rover
from terramechanics.vehicle.wheel_places import WheelPlaces, wheel_order

LONGEST_GAP_S = 1.0
"""[s] A longer time without an observation leaves the way unknown."""
_STRETCH = 0.25
"""[wheel radii] Way of the fastest wheel for which one depth is kept."""
_LENGTHS = 2.0
"""[rover's lengths] Way that is kept: on the spot a wheel rolls up to 1.6 to where the next was."""
_STRAIGHT = 0.2
"""[rad] Turn within the way that is kept, beyond which axles are not followed.

Left and right are averaged then, and wheels run beside the tracks by a tenth of the rover's length.
"""
_FASTEST_TURN = 10.0
"""[rad/s] No rover turns faster; beyond it a unit is wrong."""
_NOISE = 2.0
"""[standard deviations] Noise allowed to a velocity backwards."""
_JITTER = 0.25
"""[stretches] Way back that noise makes of a wheel which stands or rolls forward."""
_ON = 0.75
"""[1] Part of a wheel in a track that is known, from which on the rest does not matter."""
_READING_S = 0.1
"""[s] From one observation to the next."""
_NEVER = -1e9
"""[m] Place of a front that never was."""
_LEAST = 1e-9
"""[m] Way with which a reading counts that was taken on the spot."""
_FARTHEST = 1e12
"""[SI] Bound of the numbers of a saved state."""


class _Trails(NamedTuple):
    """Where the wheels were at n instants, and the ground that they left on the way there."""

    places: Floats  # [n, W, 2] [m]
    bottom: Floats  # [n, W] [m] below undisturbed ground; NaN: not known
    variance: Floats  # [n, W] [m^2]
    body: Floats  # [n, 2] heading [rad], and variance of the odometry to the side [m^2]

    def and_then(self, other: "_Trails", most: int) -> "_Trails":
        """Return the last ``most`` instants of both."""
        parts = zip(self, other, strict=True)
        return _Trails(*(np.concatenate(part)[-most:] for part in parts))


class _Below(NamedTuple):
    """Ground at each wheel [W]."""

    depth: Floats  # [m] below undisturbed ground; NaN: not known
    variance: Floats  # [m^2]


class WheelTracks:
    """The tracks of one rover's wheels; without a local sinkage nothing is kept."""

    def __init__(self, rover: Rover, places: WheelPlaces | None, standstill_speed: float) -> None:
        """Begin without tracks; ``places`` are those of a model by wheel, None: it is by axle.

        Wheels whose rims are all slower than ``standstill_speed`` [m/s] stand.
        """
        axle = list(range(rover.axles))
        y = np.zeros(rover.axles)
        if places is not None:
            order = list(wheel_order(rover))
            axle = [rover.wheels[k].axle for k in order]
            y = np.array(wheel_sides(rover, places.track_width))[order]
        self._by_wheel, self._standstill_speed = places is not None, standstill_speed
        self._wheels = np.stack([np.array(rover.axle_x)[axle], y], -1)  # [W, 2] [m], of the body
        self._radius, self._width = rover.wheel_radius, rover.wheel_width
        self._front = self._wheels[:, 0].max()
        self._side = self._wheels[:, 1].max() + self._width
        self._reach = float(_length(self._wheels[:, None] - self._wheels).max())
        # how many wheels an error of each reading is in: its own, and those that follow
        self._shared = rover.axles - np.array(axle, dtype=np.float64)
        self._stretch = _STRETCH * rover.wheel_radius
        self._jitter = _JITTER * self._stretch
        self._most = math.ceil(_LENGTHS * self._reach / self._stretch) + 1
        self.forget()

    def forget(self) -> None:
        """Forget the tracks, as where the way since then is not known."""
        self._stamp_ns: int | None = None
        self._trails = _Trails(*(np.empty((0,)) for _ in _Trails._fields))
        self._pose = np.zeros(4)  # x, y [m], heading [rad], variance to the side [m^2]
        self._motion = np.zeros(3)  # velocity ahead and to the left [m/s], yaw rate [rad/s]
        self._gone = 0.0  # [m] way of the fastest wheel since the begin
        # signed way of the body, its farthest, and where the front was when it backed last [m]
        self._ahead = np.array([0.0, 0.0, _NEVER])
        # way, and with it sinkage, its variance, the depth of the track before, its variance
        self._open = np.zeros((5, len(self._wheels)))
        self._backing = np.zeros(len(self._wheels), dtype=np.bool_)  # wheels that roll backwards
        self.lacks = ""
        """Why a sinkage of the last observation is not known; empty where all tracks are."""

    def undisturbed(self, observation: Observation) -> Observation:
        """Return the observation with sinkages from undisturbed ground; NaN where not known."""
        self.lacks = ""
        if not observation.local:
            if self._stamp_ns is not None:
                self.forget()  # what the wheels leave is not followed
            return observation
        with np.errstate(all="ignore"):  # the screening refuses what is no number afterwards
            return self._of_undisturbed_ground(observation)

    def _of_undisturbed_ground(self, observation: Observation) -> Observation:
        back_s = 0.0
        if self._stamp_ns is not None:
            back_s = (self._stamp_ns - observation.stamp_ns) * 1e-9
        if self._stamp_ns is not None and 0.0 <= back_s <= LONGEST_GAP_S:
            return _unknown(observation)  # out of order, or twice
        if back_s > 0.0:
            self.forget()  # the clock was set back
        motion = self._measured_motion(observation)
        if motion is None:  # as if nothing had come: a short gap is bridged
            self.lacks = "local sinkages need the rover's motion, which is not known"
            return _unknown(observation)
        turned = (observation.wheel_rate < 0.0) != self._backing
        rolled = self._moved(observation, motion, turned)
        self._stamp_ns, self._motion = observation.stamp_ns, motion
        before = self._before(observation)
        if self._gone:  # where a wheel turns back, nobody knows on which side it measures
            before = before._replace(depth=np.where(turned, np.nan, before.depth))
            if turned.any():
                self.lacks = "local sinkages are not known where a wheel turns back"
        return self._converted(observation, rolled, before)

    def _measured_motion(self, observation: Observation) -> Floats | None:
        """Return velocities ahead and to the left [m/s] and yaw rate [rad/s]; None if unknown.

        A planar rover does not slide aside, and turns only where that is measured.
        """
        rates = observation.wheel_rate
        if bool((np.abs(rates) * self._radius < self._standstill_speed).all()):
            return np.zeros(3)
        motion = np.array(
            [observation.velocity, observation.lateral_velocity, observation.yaw_rate]
        )
        if not self._by_wheel:
            motion[1:] = 0.0, np.nan_to_num(motion[2])
        possible = np.abs(motion) <= (FASTEST, FASTEST, _FASTEST_TURN)
        return motion if bool(possible.all()) else None

    def _moved(self, observation: Observation, motion: Floats, turned: NDArray[np.bool_]) -> Floats:
        """Go on to the place of an observation; return the way [W] [m] of each wheel to it.

        ``turned`` [W] says which wheels roll the other way now. Where the way is not known, begin.
        """
        if self._stamp_ns is not None:
            passed_s = (observation.stamp_ns - self._stamp_ns) * 1e-9
            before = self._places()
            if bool(turned.any()) and self._since_kept() > self._jitter:
                self._keep(self._left())  # what wheels leave up to where they turn back
            self._backing = observation.wheel_rate < 0.0
            self._go(0.5 * passed_s * float(self._motion[0] + motion[0]))
            self._pose = self._moved_pose(observation, motion, passed_s)
            rolled = _length(self._places() - before)
            farthest = float(rolled.max())
            change = abs(self._pose[2] - self._trails.body[0, 0])
            followed = self._by_wheel or change <= _STRAIGHT
            if passed_s <= LONGEST_GAP_S and farthest <= self._reach and followed:
                self._gone += farthest
                return rolled
        self.forget()
        self._backing = observation.wheel_rate < 0.0
        nothing = np.full(len(self._wheels), np.nan)
        self._keep(_Below(nothing, nothing))
        return np.zeros(len(self._wheels))

    def _go(self, way: float) -> None:
        """Take a signed way [m] of the body.

        A rover that rocks wears out the tracks that are kept. So after any way back a wheel beside
        them is not on fresh ground until it is beyond where the front has been.
        """
        before, farthest, old = self._ahead.tolist()
        here = before + way
        if here < farthest - self._jitter:
            old = farthest + self._front
        self._ahead = np.array([here, max(here, farthest), old])

    def _moved_pose(self, observation: Observation, motion: Floats, passed_s: float) -> Floats:
        """Return the pose after a time with the mean of two motions."""
        ahead, left, turn = 0.5 * passed_s * (self._motion + motion)
        x, y, heading, drift = self._pose.tolist()
        if not self._by_wheel:  # its axles are in one track until it has turned too far
            return np.array([x + ahead, y, heading + turn, drift])
        sine, cosine = math.sin(heading + 0.5 * turn), math.cos(heading + 0.5 * turn)
        side = self._side_sd(observation)
        moves = bool(np.any(self._motion) or np.any(motion))
        return np.array(
            [
                x + cosine * ahead - sine * left,
                y + sine * ahead + cosine * left,
                heading + turn,
                drift + (passed_s * side) ** 2 * moves,
            ]
        )

    def _side_sd(self, observation: Observation) -> float:
        """Return the standard deviation [m/s] of the motion to the side of a track."""
        speed = max(abs(observation.velocity), self._standstill_speed, _LEAST)
        bend = min(1.0, abs(observation.yaw_rate) * self._reach / speed)  # in which ahead is aside
        return math.hypot(
            _known(observation.lateral_velocity_sd),
            self._reach * _known(observation.yaw_rate_sd),
            bend * _known(observation.velocity_sd),
        )

    def _places(self) -> Floats:
        """Return the places of the wheels [W, 2] [m]."""
        if not self._by_wheel:
            return np.asarray(self._wheels + self._pose[:2])
        sine, cosine = math.sin(self._pose[2]), math.cos(self._pose[2])
        turned = self._wheels @ np.array([[cosine, sine], [-sine, cosine]])
        return np.asarray(turned + self._pose[:2])

    def _converted(self, observation: Observation, rolled: Floats, before: _Below) -> Observation:
        """Convert the readings of wheels that ``rolled`` [W] [m], and keep what they leave."""
        reading, deviation = observation.sinkage, observation.sinkage_sd
        sinkage = reading + before.depth
        # The error of a track is that of every wheel that rolls in it, and at one place the same
        # for all of them, which the model does not know: it takes errors as independent.
        variance = self._shared * deviation**2 + before.variance
        sound = np.array([is_deviation(each) for each in deviation.tolist()])
        sound &= np.abs(reading) <= self._radius
        way = np.where(sound, rolled + _LEAST, 0.0)
        taken = [np.ones_like(way), sinkage, variance, before.depth, before.variance]
        self._open += np.where(way > 0.0, way * np.array(taken), 0.0)
        if self._since_kept() >= self._stretch:
            self._keep(self._left())
        return dataclasses.replace(
            observation,
            sinkage=sinkage,
            sinkage_sd=np.where(sound, np.sqrt(np.abs(variance)), deviation),
            local=False,
        )

    def _since_kept(self) -> float:
        """Return how far [m] the wheels are from the places that were kept last."""
        return float(_length(self._places() - self._trails.places[-1]).max())

    def _left(self) -> _Below:
        """Return the ground that the wheels left since the last instant that is kept."""
        sunk, variance, before, variance_before = self._open[1:] / self._open[0]
        risen = sunk < before  # the wheel rode above the bottom of the track
        return _Below(np.where(risen, before, sunk), np.where(risen, variance_before, variance))

    def _keep(self, left: _Below) -> None:
        """Keep the present places of the wheels, and the ground that they left on the way."""
        now = (self._places(), *left, self._pose[2:])
        now = _Trails(*(np.array(each)[np.newaxis] for each in now))
        first = not len(self._trails.places)
        self._trails = now if first else self._trails.and_then(now, self._most)
        self._open = np.zeros_like(self._open)

    def _before(self, observation: Observation) -> _Below:
        """Return the ground right before each wheel."""
        places, count = self._places(), len(self._wheels)
        if len(self._trails.places) < 2:
            found, on = _Below(np.zeros(count), np.zeros(count)), np.zeros(count)
        else:
            found, on = self._tracks_at(places, self._side_sd(observation))
        # beside all tracks that are known the ground is fresh, but where the rover came from
        jitter = np.where(self._wheels[:, 0] < self._front, 0.0, self._jitter)
        came = (np.abs(places[:, 1]) <= self._side) & (self._gone < _LENGTHS * self._reach)
        ahead = np.where(came, self._front - jitter - places[:, 0], 0.0)
        backs = self._backs(observation)
        old = self._ahead[2] - self._ahead[0] - self._wheels[:, 0]
        unknown = (ahead > 0.0) & (on < 1.0) | (on < _ON) & (backs | (old > 0.0))
        depth = np.where(unknown, np.nan, found.depth)
        if np.isnan(depth[~np.isnan(observation.sinkage)]).any():
            left = ahead if backs else np.maximum(ahead, old)
            way = left[np.isnan(depth)].max(initial=0.0)
            self.lacks = "local sinkages need the tracks of the wheels ahead: "
            self.lacks += f"known in {way:.2g} m" if way else "they are not known here"
        return _Below(depth, found.variance)

    def _tracks_at(self, places: Floats, side_sd: float) -> tuple[_Below, Floats]:
        """Return the deepest track at each of ``places``, and the part [W] of a wheel in it.

        ``side_sd`` [m/s] is that of the odometry to the side.
        """
        trails = self._trails
        start, way = trails.places[:-1].swapaxes(0, 1), np.diff(trails.places, axis=0)
        way = way.swapaxes(0, 1)  # [W, n - 1, 2]
        off = places[:, np.newaxis, np.newaxis] - start  # [W, wheels before, n - 1, 2]
        distance, share = beside(off, way, _length)
        # a wheel's own track ends behind it, unless it backs over it
        behind = share >= 1.0
        to_end = (1.0 - share[..., -1]) * _length(way[:, -1])
        behind[..., -1] |= (to_end < self._jitter) & ~self._backing[:, np.newaxis]
        own = np.eye(len(places), dtype=np.bool_)[..., np.newaxis]
        distance = np.where(own & behind, np.inf, distance)
        least = distance.min(-1, keepdims=True)
        there = passed(distance, share, least, self._jitter)
        nearest = distance.shape[-1] - 1 - there[..., ::-1].argmax(-1)
        wheels, drift = np.arange(len(places)), self._pose[3] - trails.body[1:, 1][nearest]
        # the noise of the odometry is no distance: it adds its variance to the square of one
        part = covered(np.sqrt((least[..., 0] ** 2 - drift).clip(0.0)), self._width)
        bottom = trails.bottom[1:].T[wheels, nearest]
        variance = part**2 * trails.variance[1:].T[wheels, nearest]
        # The error of the place beside a track lasts for as many readings as it took to come
        # about: to the model, which takes errors as independent, its variance is that many times.
        readings = (drift / max((side_sd * _READING_S) ** 2, _LEAST**2)).clip(1.0)
        edge = (bottom / self._width) ** 2 * drift * readings
        variance = np.where(part > 0.0, variance + edge, 0.0)
        depth = np.where(part > 0.0, part * bottom, 0.0)
        deepest = np.where(np.isnan(depth), np.inf, depth).argmax(-1)
        found = _Below(depth[wheels, deepest], variance[wheels, deepest])
        return found, part.max(-1)

    def _backs(self, observation: Observation) -> bool:
        """Return whether the rover backs out, over what was before the tracks that are kept."""
        if bool(np.isfinite(observation.wheel_rate).all()):
            return bool(self._backing.all())
        return observation.velocity < -_NOISE * observation.velocity_sd

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all that the next conversion depends on; nothing where nothing is kept."""
        if self._stamp_ns is None:
            return {}
        count = len(self._trails.places)
        nodes = [each.reshape(count, -1) for each in self._trails]
        return {
            "tracks.stamp": np.array(self._stamp_ns, dtype=np.int64),
            "tracks.trails": np.concatenate(nodes, 1),
            "tracks.open": np.vstack([self._open, self._backing]),
            "tracks.numbers": np.array([*self._pose, *self._motion, self._gone, *self._ahead]),
        }

    def restore(self, arrays: Arrays) -> None:
        """Go on from what :meth:`arrays` gave. Raises StateFileError, and nothing is changed."""
        found = {name: each for name, each in arrays.items() if name.startswith("tracks.")}
        if not found:
            self.forget()
            return
        wheels = len(self._wheels)
        trails = found.get("tracks.trails", np.empty(0))
        count = len(trails) if trails.ndim else 0
        expected = {
            "tracks.stamp": ((), "int64"),
            "tracks.trails": ((min(max(count, 1), self._most), 4 * wheels + 2), "float64"),
            "tracks.open": ((6, wheels), "float64"),
            "tracks.numbers": ((11,), "float64"),
        }
        shapes = {name: (each.shape, each.dtype.name) for name, each in found.items()}
        if shapes != expected:
            raise _refused(f"are {shapes}, those of this rover are {expected}")
        stamp_ns = int(found["tracks.stamp"])
        parts = np.split(trails, np.cumsum([2 * wheels, wheels, wheels]), axis=1)
        places, bottom, variance, body = parts
        numbers = found["tracks.numbers"]
        known = [places, body, numbers, bottom[~np.isnan(bottom)], variance[~np.isnan(bottom)]]
        bounded = all((np.abs(each) <= _FARTHEST).all() for each in known)
        sound = np.array_equal(np.isnan(bottom), np.isnan(variance) | np.isnan(bottom))
        opened, backing = found["tracks.open"][:5], found["tracks.open"][5]
        least = min(body[:, 1].min(), np.nanmin(np.where(np.isnan(variance), 0.0, variance)))
        ordered = bool((np.diff(body[:, 1]) >= 0.0).all() and numbers[3] >= body[-1, 1])
        ordered &= bool(numbers[7] >= 0.0 and numbers[8] <= numbers[9])
        if not (stamp_ns >= 0 and bounded and sound and least >= 0.0 and ordered):
            raise _refused("have places, depths or variances that no drive leaves")
        opened_well = (opened[0] >= 0.0).all() and (np.abs(opened[~np.isnan(opened)]) <= _FARTHEST)
        opened_well &= not (opened[[2, 4]] < 0.0).any()  # variances
        if not (np.all(opened_well) and np.isin(backing, (0.0, 1.0)).all()):
            raise _refused("have readings that no drive leaves")
        self._stamp_ns, self._open, self._backing = stamp_ns, opened.copy(), backing == 1.0
        self._trails = _Trails(places.reshape(count, wheels, 2), bottom, variance, body)
        self._pose, self._motion = numbers[:4].copy(), numbers[4:7].copy()
        self._gone, self._ahead = float(numbers[7]), numbers[8:].copy()
        self.lacks = ""


def _unknown(observation: Observation) -> Observation:
    nothing = np.full_like(observation.sinkage, np.nan)
    return dataclasses.replace(observation, sinkage=nothing, local=False)


def _refused(reason: str) -> StateFileError:
    return StateFileError(f"the state's tracks {reason}: start without it, from the prior")


def _known(deviation: float) -> float:
    """Return a deviation; 0 where there is none."""
    return deviation if is_deviation(deviation) else 0.0


def _length(vectors: Floats) -> Floats:
    """Return the lengths [...] of vectors [..., 2]."""
    return np.asarray(np.sqrt((vectors * vectors).sum(-1)))
