# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Ruts that stay: what the wheels before did to the ground below a wheel.

The wheels of a side run in one track. What a wheel finds is what those before left when they were
at the same place, one or two distances of axles ago: that is looked up by distance. Where only one
instant is known, what they do now stands in for it.
"""

from typing import Protocol

import torch
from torch import Tensor

from terramechanics.contact.scm import Rut, shear_left

REBOUND = 0.02
"""[1] Rebound that is taken where none is known: SCM's usual stiffness on sand."""


def passed(before: Rut, slip: Tensor, sinkage: Tensor, radius: float, rebound: Tensor) -> Rut:
    """Return the rut that a wheel leaves which found ``before``; shapes [...]."""
    own = torch.clamp(sinkage - before.depth * (1.0 - rebound), min=0.0)
    return Rut(torch.maximum(before.depth, sinkage), before.shear + shear_left(slip, own, radius))


def ruts_now(slip: Tensor, sinkage: Tensor, radius: float, rebound: Tensor) -> Rut:
    """Return the ruts [..., A] below A axles, as if those before rolled the same way before.

    All are [..., A], the front axle first.
    """
    found = Rut(torch.zeros_like(slip[..., 0]), torch.zeros_like(slip[..., 0]))
    depths, shears = [found.depth], [found.shear]
    for axle in range(slip.shape[-1] - 1):
        found = passed(found, slip[..., axle], sinkage[..., axle], radius, rebound[..., axle])
        depths.append(found.depth)
        shears.append(found.shear)
    return Rut(torch.stack(depths, -1), torch.stack(shears, -1))


def ruts_by_distance(
    distance: Tensor,
    slip: Tensor,
    sinkage: Tensor,
    axle_x: Tensor,
    radius: float,
    at: Tensor,
) -> Rut:
    """Return the ruts [N, A] at distances ``at`` [N] [m] of a drive.

    ``distance`` [T] [m] rises; ``slip`` and ``sinkage`` [T, A] were measured there, and the front
    axle is the first of ``axle_x`` [A] [m]. Before the drive begins the ground is taken as the
    wheels leave it at its begin.
    """
    rebound = torch.tensor(REBOUND, dtype=slip.dtype)
    here = Rut(torch.zeros_like(distance), torch.zeros_like(distance))
    found = [Rut(torch.zeros_like(at), torch.zeros_like(at))]
    for axle in range(axle_x.shape[0] - 1):
        left = passed(here, slip[:, axle], sinkage[:, axle], radius, rebound)
        behind = axle_x[axle] - axle_x[axle + 1]
        here = _looked_up(left, distance, distance - behind)
        found.append(_looked_up(left, distance, at - behind))
    return Rut(
        torch.stack([each.depth for each in found], -1),
        torch.stack([each.shear for each in found], -1),
    )


def _looked_up(rut: Rut, places: Tensor, at: Tensor) -> Rut:
    """Return a rut [..., T] known at rising ``places`` [..., T] where it is ``at`` [..., N]."""
    return Rut(interpolated(places, rut.depth, at), interpolated(places, rut.shear, at))


def interpolated(places: Tensor, values: Tensor, at: Tensor) -> Tensor:
    """Return ``values`` [..., T] at rising ``places`` [..., T], linearly, ``at`` [..., N].

    Outside the end values hold.
    """
    last = places.shape[-1] - 1
    if last == 0:
        return values.expand(*values.shape[:-1], at.shape[-1])
    after = torch.searchsorted(places.contiguous(), at.contiguous()).clamp(1, last)
    low, high = places.gather(-1, after - 1), places.gather(-1, after)
    share = ((at - low) / (high - low).clamp(min=1e-12)).clamp(0.0, 1.0)
    return torch.lerp(values.gather(-1, after - 1), values.gather(-1, after), share)


class Ruts(Protocol):
    """The ruts below the wheels of a batch of rovers."""

    def at(self, places: Tensor) -> Rut:
        """Return the ruts at the wheels' ``places`` [batch, A] [m], the front axle first."""

    def remember(
        self, places: Tensor, before: Rut, slip: Tensor, sinkage: Tensor, rebound: Tensor
    ) -> None:
        """Keep what the wheels at ``places`` [batch, A] left, which found ``before``."""


class KnownRuts:
    """Ruts that were measured along the way, whatever the wheels do."""

    def __init__(self, gone: Tensor, ruts: Rut, times: int) -> None:
        """``ruts`` [W, A, T] were below the wheels after ``gone`` [W, T] [m].

        There are ``times`` W rovers.
        """
        way = torch.cummax(gone, -1).values.unsqueeze(1)
        self._gone = way.expand(-1, ruts.depth.shape[1], -1).repeat(times, 1, 1)
        self._ruts = Rut(*(part.repeat(times, 1, 1) for part in ruts))
        self._start: Tensor | None = None

    def at(self, places: Tensor) -> Rut:
        """Return the ruts at the wheels' ``places`` [batch, A] [m]; the first are the start."""
        self._start = places if self._start is None else self._start
        found = _looked_up(self._ruts, self._gone, (places - self._start).unsqueeze(-1))
        return Rut(*(part.squeeze(-1) for part in found))

    def remember(
        self, places: Tensor, before: Rut, slip: Tensor, sinkage: Tensor, rebound: Tensor
    ) -> None:
        """Keep nothing."""


class RutMemory:
    """What the wheels of a batch of rovers left at the places where they were."""

    def __init__(self, radius: float) -> None:
        """Begin on ground that nobody touched."""
        self._radius = radius
        self._places: list[Tensor] = []  # [batch, A] each
        self._left: list[Rut] = []  # [batch, A] each

    def at(self, places: Tensor) -> Rut:
        """Return the ruts at the wheels' ``places`` [batch, A] [m], the front axle first.

        Before the first place that is remembered the ground is as it was left there.
        """
        zero = torch.zeros_like(places[:, :1])
        if not self._left:
            none = torch.zeros_like(places)
            return Rut(none, none)
        where = torch.stack(self._places, -1)  # [batch, A, T]
        kept = Rut(*(torch.stack(part, -1) for part in zip(*self._left, strict=True)))
        ahead = Rut(kept.depth[:, :-1], kept.shear[:, :-1])
        found = _looked_up(ahead, where[:, :-1], places[:, 1:].unsqueeze(-1))
        return Rut(*(torch.cat([zero, part.squeeze(-1)], 1) for part in found))

    def remember(
        self, places: Tensor, before: Rut, slip: Tensor, sinkage: Tensor, rebound: Tensor
    ) -> None:
        """Keep what the wheels at ``places`` [batch, A] left, which found ``before``."""
        if self._places:
            places = torch.maximum(places, self._places[-1])
            if torch.equal(places, self._places[-1]):  # all stand
                return
        self._places.append(places)
        self._left.append(passed(before, slip, sinkage, self._radius, rebound))
        behind = self._places[-1].amin(-1, keepdim=True)
        while len(self._places) > 2 and bool((self._places[1] < behind)[:, :-1].all()):
            del self._places[0], self._left[0]
