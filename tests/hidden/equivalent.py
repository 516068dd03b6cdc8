# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The size at which a law as simple as the library's comes closest to a hidden one.

Hidden laws are others than the library's, so no size is simply true. Here each is projected by
least squares onto the plain law of its name (docs/effects.md), over all samples of some drives:
what it does to force, torque, exponent, stiffness or reading.
"""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from terramechanics.simulation.plant import ContactInputs, Effect, Situation
from terramechanics.simulation.sample import Drive
from tests.hidden.sensing import Sensed
from tests.hidden.soil import Sized, entry

Pair = tuple[Tensor, Tensor]
"""Effects of the hidden law, and of the plain law of size 1: [samples, axles or 1, (laws)]."""
Law = Callable[[Effect, Situation, ContactInputs, Drive], Pair]
_ONE = torch.ones(1, 1, dtype=torch.float64)


def equivalent_size(name: str, effect: Effect, drive: Drive, episodes: Sequence[int]) -> float:
    """Return the size in the unit of the plain law, from drives of a batch; NaN without a law."""
    if name not in LAWS:
        return float("nan")
    sample = drive.sample
    batch, steps = sample.velocity.shape
    episode = torch.arange(batch).repeat_interleave(steps)
    flat = {
        key: getattr(sample, key).flatten(0, 1)
        for key in ("contact", "wheel_rate", "velocity", "slip", "sinkage", "constants", "strength")
    }
    where = Situation(
        drive.rover, 0.0, episode, flat["contact"], flat["wheel_rate"], flat["velocity"]
    )
    contact = ContactInputs(flat["slip"], flat["sinkage"], flat["constants"], flat["strength"])
    done, plain = LAWS[name](effect, where, contact, drive)
    plain = plain if plain.dim() == 3 else plain.unsqueeze(-1)
    done, plain = (
        part.expand(batch * steps, *part.shape[1:]) for part in (done.unsqueeze(-1), plain)
    )
    chosen = (
        torch.isin(episode, torch.tensor(episodes))
        & ~sample.stuck.flatten()
        & ~sample.standing.flatten()
    )
    pair = (done[chosen], plain[chosen])
    done, plain = torch.broadcast_tensors(*pair)  # type: ignore[no-untyped-call]
    size = (done * plain).sum((0, 1)) / plain.square().sum((0, 1))
    left = (done - size * plain).square().sum((0, 1))
    return float(size[left.argmin()])


def _reading(signal: str) -> Law:
    def shifted(_effect: Effect, _where: Situation, _contact: ContactInputs, drive: Drive) -> Pair:
        change = getattr(drive.seen, signal) - getattr(drive.sample, signal)
        return change.reshape(change.shape[0] * change.shape[1], -1), _ONE

    return shifted


def _radius_error(
    _effect: Effect, _where: Situation, _contact: ContactInputs, drive: Drive
) -> Pair:
    return ((1.0 - drive.sample.slip) / (1.0 - drive.seen.slip)).flatten(0, 1) - 1.0, _ONE


def _resistance(effect: Effect, where: Situation, contact: ContactInputs, _drive: Drive) -> Pair:
    z, (cohesion, tan_phi) = contact.sinkage, contact.strength.unbind(-1)
    plain = z * (0.75 * 0.02 * cohesion / 2000.0 + 0.25 * z * tan_phi / 0.58)
    return -_thrust(effect, where, contact), plain


def _lug_thrust(effect: Effect, where: Situation, contact: ContactInputs, drive: Drive) -> Pair:
    """Return the effects of the laws; the slip of mobilisation is a free parameter, too."""
    mobilised = 0.1 * torch.exp(torch.linspace(-2.8, 2.8, 57, dtype=torch.float64))
    slip, normal = contact.slip.unsqueeze(-1), drive.sample.normal.flatten(0, 1)
    rover = where.rover
    area = rover.wheel_width * rover.wheel_radius * entry(contact, rover.wheel_radius)
    held = (normal + 2.0 * contact.strength[..., 0] * area) * len(rover.wheels) / rover.weight
    plain = held.unsqueeze(-1) * torch.sign(slip) * (1.0 - torch.exp(-slip.abs() / mobilised))
    return _thrust(effect, where, contact, normal), plain


def _thrust(
    effect: Effect, where: Situation, contact: ContactInputs, normal: Tensor | None = None
) -> Tensor:
    """Return what an effect adds to T where N is ``normal``."""
    load = torch.zeros_like(contact.slip) if normal is None else normal
    return effect.push(
        where, contact, torch.stack([load, torch.zeros_like(load), torch.zeros_like(load)], dim=-1)
    )[..., 1]


def _friction(power: float) -> Law:
    def lost(effect: Effect, where: Situation, _contact: ContactInputs, _drive: Drive) -> Pair:
        loss = effect.friction(where)
        assert loss is not None
        return loss, where.rate**power

    return lost


def _mass(effect: Effect, where: Situation, _contact: ContactInputs, _drive: Drive) -> Pair:
    load = effect.payload(where)
    assert load is not None
    return load.mass.unsqueeze(-1), _ONE


def _exponent(effect: Effect, where: Situation, contact: ContactInputs, _drive: Drive) -> Pair:
    """Return the exponent that gives the pressure at the bottom at the depth z."""
    dug, n = effect.contact(where, contact), contact.constants[..., 0]
    softer = (dug.constants[..., 2] / contact.constants[..., 2]).log()
    pressure = softer + n * (dug.sinkage / contact.sinkage).log()
    return pressure / contact.sinkage.log(), contact.slip.abs()


def _speed_exponent(
    effect: Effect, where: Situation, contact: ContactInputs, _drive: Drive
) -> Pair:
    return _stiffening(effect, where, contact).log(), (where.speed / 0.1).log()


def _pass_stiffening(
    effect: Effect, where: Situation, contact: ContactInputs, _drive: Drive
) -> Pair:
    """Return the effect of the first pass; the share of later ones is a free parameter, too."""
    second = (where.order == 1.0).to(torch.float64).unsqueeze(0)
    return (_stiffening(effect, where, contact) - 1.0) * second, second


def _stiffening(effect: Effect, where: Situation, contact: ContactInputs) -> Tensor:
    return effect.contact(where, contact).constants[..., 2] / contact.constants[..., 2]


def _rebound(effect: Effect, where: Situation, contact: ContactInputs, _drive: Drive) -> Pair:
    angle = effect.contact(where, contact).exit_angle
    assert angle is not None
    return (1.0 - torch.cos(angle)) * where.rover.wheel_radius, contact.sinkage


def _own_size(factor: float) -> Law:
    def scaled(effect: Effect, where: Situation, _contact: ContactInputs, _drive: Drive) -> Pair:
        assert isinstance(effect, Sized | Sensed)
        return factor * effect.sizes[where.episode, None], _ONE

    return scaled


MEAN_LOSS = 0.95
"""[1] Mean of 1 - 0.05 (1 + cos): loss of the worn coupling over a turn, in units of its size."""

LAWS: dict[str, Law] = {
    "slope_bias": _reading("pitch"),
    "bulldozing": _resistance,
    "drive_drag": _friction(1.0),
    "coulomb_drag": _friction(0.0),
    "payload": _mass,
    "grousers": _lug_thrust,
    "slip_sinkage": _exponent,
    "multipass": _pass_stiffening,
    "odometry_scale": _radius_error,
    "failed_wheel": _own_size(MEAN_LOSS),
    "sinkage_bias": _reading("sinkage"),
    "latency": _own_size(1.0),
    "rate_dependence": _speed_exponent,
    "exit_angle": _rebound,
}
