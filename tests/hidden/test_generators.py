# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Hidden effects act in the right place, direction and size, and share only the library's names."""

import ast
import math
from dataclasses import fields, replace
from functools import cache
from pathlib import Path

import pytest
import torch
from scipy import integrate
from torch import Tensor

from terramechanics.effects import EFFECTS
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.plant import ContactInputs, Plant, Situation
from terramechanics.simulation.sample import TIME_STEP, Drive, Sample
from terramechanics.simulation.sensors import Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch
from tests.hidden import soil
from tests.hidden.generators import GENERATORS, SCALES, Draw, sizes_of
from tests.samples import sampled

MARS = load_rover("mars_rover")
HERE = Path(__file__).parent
BATCH, SECONDS = 3, 8.0
PART_S = sampled(2.0, SECONDS)
PART = round(PART_S / TIME_STEP)
"""Seconds and samples of what is compared to the very number."""
SENSORS = (
    "slope_bias", "odometry_scale", "sinkage_bias", "latency", "gain_drift", "slow_clock",
    "current_limit",
)  # fmt: skip
DRIVES = ("drive_drag", "coulomb_drag")
FORBIDDEN = ("terramechanics.effects", "terrain_estimator.discovery")


def imported(file: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def draw(sizes: Tensor) -> Draw:
    return Draw(sizes, torch.full((BATCH,), 1), torch.full((BATCH,), 0.8, dtype=torch.float64))


def drive(name: str = "", share: float = 0.0, seconds: float = SECONDS) -> Drive:
    generator = torch.Generator().manual_seed(23)
    strength = torch.tensor([[2500.0, 0.6], [1500.0, 0.7], [3500.0, 0.5]], dtype=torch.float64)
    ground = Ground([Patch(load_soil("loose_sand").constants(), strength)])
    sizes = torch.full((BATCH,), share, dtype=torch.float64)
    plant = Plant([GENERATORS[name].make(draw(GENERATORS[name].matters * sizes))]) if name else None
    return simulate(MARS, ground, "S1", seconds, generator, BATCH, plant=plant)


@cache
def nominal() -> Drive:
    return drive()


@cache
def hidden(name: str, share: float = 1.0) -> Drive:
    return drive(name, share)


def moved(name: str, signal: str, share: float = 1.0) -> Tensor:
    return getattr(hidden(name, share).seen, signal) - getattr(nominal().seen, signal)


def test_generators_import_neither_the_library_of_effects_nor_discovery() -> None:
    sources = [file for file in HERE.glob("*.py") if not file.name.startswith("test_")]
    assert len(sources) >= 7
    for file in sources:
        assert not {name for name in imported(file) if name.startswith(FORBIDDEN)}, file.name


def test_the_library_does_not_import_the_generators() -> None:
    root = HERE.parents[1]
    files = [
        file
        for package in ("terramechanics", "terrain_estimator", "rover_sim_node")
        for file in (root / package / package).rglob("*.py")
    ]
    assert len(files) > 80
    assert not [file for file in files if any(name.startswith("tests") for name in imported(file))]


def test_every_simulated_effect_of_the_library_can_be_hidden_and_seven_others_cannot_be_named() -> (
    None
):
    # The contact law is hidden in the drives of another engine: bags/foreign, docs/discovery.md.
    named = {name for name, effect in EFFECTS.items() if effect.planar} - {"contact_law_scm"}
    assert {name for name, effect in GENERATORS.items() if effect.known} == named
    assert {name for name, effect in GENERATORS.items() if not effect.known} == {
        "tether",
        "gain_drift",
        "crust",
        "slow_clock",
        "rocks",
        "wheel_flex",
        "current_limit",
    }


@pytest.mark.parametrize("name", GENERATORS)
def test_a_hidden_effect_without_size_leaves_everything_as_it_is(name: str) -> None:
    run = drive(name, 0.0, seconds=PART_S)
    for series, plain in ((run.sample, nominal().sample), (run.seen, nominal().seen)):
        for item in fields(Sample):
            torch.testing.assert_close(
                getattr(series, item.name),
                getattr(plain, item.name)[:, :PART],
                rtol=1e-9,
                atol=1e-9,
                equal_nan=True,
            )


@pytest.mark.parametrize("name", GENERATORS)
def test_at_its_size_an_effect_shows_in_some_signal_and_fades_with_its_size(name: str) -> None:
    """Return the largest change of any signal over the published deviation of its sensor."""
    quiet = measure_drive(
        MARS, nominal().seen, Noise(factor=1e-3), torch.Generator().manual_seed(1)
    )
    signals = ("velocity", "slip", "sinkage", "torque", "pitch")

    def shown(share: float) -> float:
        spreads = {
            signal: torch.as_tensor(getattr(quiet, f"{signal}_sd")) * 1e3 for signal in signals
        }
        return max(
            float((moved(name, signal, share) / spreads[signal]).square().mean().sqrt())
            for signal in signals
        )

    whole, tenth = shown(1.0), shown(0.1)
    assert whole > 0.01  # in these eight seconds; a tether and a slow clock have hardly begun
    assert 2.5 < whole / tenth < 30.0


@pytest.mark.parametrize(
    ("name", "signal", "sign"),
    [
        ("bulldozing", "slip", 1), ("payload", "sinkage", 1), ("grousers", "slip", -1),
        ("slip_sinkage", "sinkage", 1), ("exit_angle", "sinkage", -1), ("tether", "slip", 1),
        ("crust", "sinkage", -1), ("rocks", "sinkage", -1),
        ("multipass", "sinkage", -1), ("failed_wheel", "slip", 1), ("drive_drag", "torque", 1),
        ("coulomb_drag", "torque", 1),
    ],
)  # fmt: skip
def test_a_hidden_effect_moves_a_signal_in_its_direction(name: str, signal: str, sign: int) -> None:
    change = moved(name, signal)
    others = change[..., 1:] if name == "multipass" else change
    assert sign * float(others.mean()) > 0.0


@pytest.mark.parametrize("name", [*SENSORS, *DRIVES])
def test_hidden_sensors_and_drives_do_not_move_the_rover(name: str) -> None:
    for signal in ("velocity", "slip", "sinkage", "ground_torque", "pitch"):
        assert torch.equal(getattr(hidden(name).sample, signal), getattr(nominal().sample, signal))


def test_short_lugs_push_by_the_passive_pressure_of_the_loaded_soil_that_they_shear() -> None:
    """The sum along the contact beside its integral; no push without slip."""
    size, load, slip, sinkage = 0.004, 120.0, 0.3, 0.02
    cohesion, tan_phi = 1200.0, 0.6
    radius, width = MARS.wheel_radius, MARS.wheel_width
    entered = math.acos(1.0 - sinkage / radius)
    root = tan_phi + math.sqrt(1.0 + tan_phi**2)

    def push(theta: float, direction: float) -> float:
        spread = math.pi / 2.0 * math.sin(math.pi * theta / entered) / (width * radius * entered)
        weight = soil.SOIL_DENSITY * MARS.gravity * size / 2.0
        passive = root**2 * (weight + load * spread) + 2.0 * cohesion * root
        moved = radius * slip * (entered - theta)
        per_angle = soil.LUGS / (2.0 * math.pi) * soil.LUG_WIDTH * width * size
        return direction * per_angle * passive * (1.0 - math.exp(-moved / soil.LUG_SHIFT))

    def pushed(slip: float) -> Tensor:
        wheels = torch.ones(BATCH, MARS.axles, dtype=torch.float64)
        strength = torch.tensor([cohesion, tan_phi], dtype=torch.float64)
        constants = load_soil("regolith").constants()
        contact = ContactInputs(slip * wheels, sinkage * wheels, constants, strength)
        forces = torch.zeros(BATCH, MARS.axles, 3, dtype=torch.float64)
        forces[..., 0] = load
        where = Situation(MARS, 1.0, torch.arange(BATCH), wheels, wheels, wheels[:, 0])
        sizes = torch.full((BATCH,), size, dtype=torch.float64)
        return (soil.LugFaces(sizes).push(where, contact, forces) - forces)[0, 0]

    lift, thrust = (
        integrate.quad(lambda theta, part=part: push(theta, part(theta)), 0.0, entered)[0]
        for part in (math.sin, math.cos)
    )
    whole = integrate.quad(lambda theta: push(theta, 1.0), 0.0, entered)[0]
    expected = [lift, thrust, (radius + size / 2.0) * whole]
    assert pushed(slip).tolist() == pytest.approx(expected, rel=0.01)
    assert not pushed(0.0).any()
    assert pushed(-slip)[1] < 0.0


def test_soil_that_is_entered_faster_is_stiffer() -> None:
    sample = nominal().sample
    wheels = ContactInputs(
        *(getattr(sample, name)[:, -1] for name in ("slip", "sinkage", "constants", "strength"))
    )
    effect = GENERATORS["rate_dependence"].make(
        draw(torch.full((BATCH,), 0.3, dtype=torch.float64))
    )
    stiffness = []
    for factor in (0.5, 1.0, 2.0):
        where = Situation(
            MARS,
            1.0,
            torch.arange(BATCH),
            sample.contact[:, -1],
            factor * sample.wheel_rate[:, -1],
            sample.velocity[:, -1],
        )
        stiffness.append(effect.contact(where, wheels).constants[..., 2])
    torch.testing.assert_close(stiffness[2] - stiffness[1], stiffness[1] - stiffness[0])
    torch.testing.assert_close(
        stiffness[2] - stiffness[1], 0.3 * math.log(2.0) * wheels.constants[..., 2]
    )


def test_a_load_on_the_deck_loads_the_rear_more_than_the_front() -> None:
    more = (hidden("payload").sample.normal - nominal().sample.normal).mean((0, 1))
    total = 2.0 * float(more.sum())
    assert total == pytest.approx(GENERATORS["payload"].matters * MARS.gravity, rel=0.03)
    assert more[0] < more[1:].mean()


def test_a_crust_breaks_below_one_wheel_after_the_other() -> None:
    change = moved("crust", "sinkage")[0]
    place = nominal().seen.contact[0]
    assert float(change[place < 0.5].max()) < -0.001
    assert float(change[place > 1.3].abs().max()) < 0.002


def test_a_tether_pulls_the_harder_the_further_the_rover_is() -> None:
    run, plain = hidden("tether").sample, nominal().sample
    along = 2.0 * (
        run.traction * torch.cos(run.contact_angle) - run.normal * torch.sin(run.contact_angle)
    ).sum(-1)
    pull = along - MARS.mass * run.specific_force(MARS.gravity)
    expected = GENERATORS["tether"].matters * run.contact[..., -1].clamp(min=0.0) / 10.0
    torch.testing.assert_close(pull, expected, rtol=1e-6, atol=1e-6)
    assert float((run.slip - plain.slip)[:, -1].mean()) > 0.0


def test_a_slow_clock_makes_wheel_signals_older_and_older() -> None:
    late, true = hidden("slow_clock").seen, nominal().seen
    lag = GENERATORS["slow_clock"].matters * true.time[0]
    delays = [(k, float(lag[k] / 0.1)) for k in range(10, 80)]
    slip = true.slip[0]
    past = torch.stack(
        [torch.lerp(slip[k - int(d) - 1], slip[k - int(d)], 1.0 - (d - int(d))) for k, d in delays]
    )
    torch.testing.assert_close(late.slip[0, 10:], past, rtol=1e-9, atol=1e-9)
    assert torch.equal(late.velocity, true.velocity)


def test_the_rut_is_that_of_the_wheels_before() -> None:
    true, seen = hidden("multipass").sample, hidden("multipass").seen
    floor = (true.sinkage - seen.sinkage)[:, 10:]
    assert float(floor[..., 0].abs().max()) == 0.0
    share = floor[..., 1] / GENERATORS["multipass"].matters
    torch.testing.assert_close(share.mean(1), true.sinkage[..., 0].mean(1), rtol=0.1, atol=0.0)
    assert bool((floor[..., 2] >= floor[..., 1] - 0.1 * floor[..., 1].amax()).all())


def test_sizes_without_a_share_lie_in_the_range_of_the_law_in_proportion_to_the_rover() -> None:
    generator = torch.Generator().manual_seed(4)
    light = replace(MARS, mass=0.5 * MARS.mass)
    for hidden_effect in GENERATORS.values():
        for rover in (MARS, light):
            scale = SCALES[hidden_effect.scale](rover)
            sizes = sizes_of(hidden_effect, None, 400, generator, scale).abs() / scale
            assert hidden_effect.low <= float(sizes.min()) < 1.05 * hidden_effect.low
            assert 0.95 * hidden_effect.high < float(sizes.max()) <= hidden_effect.high
    assert all(SCALES[name](MARS) == pytest.approx(1.0, rel=1e-3) for name in SCALES)
    assert SCALES["mass"](light) == pytest.approx(0.5, rel=1e-3)
    assert SCALES["per_torque"](light) == pytest.approx(2.0, rel=1e-3)


def test_a_range_begins_about_where_an_effect_matters() -> None:
    for name, hidden_effect in GENERATORS.items():
        assert 0.6 < hidden_effect.low / hidden_effect.matters < 1.0, name
        assert 2.0 < hidden_effect.high / hidden_effect.low < 5.0 or name == "failed_wheel", name


def test_sizes_lie_around_the_one_that_matters_and_have_a_sign_where_it_is_drawn() -> None:
    generator = torch.Generator().manual_seed(3)
    for hidden_effect in GENERATORS.values():
        sizes = sizes_of(hidden_effect, 1.0, 400, generator) / hidden_effect.matters
        assert 0.85 <= float(sizes.abs().min()) < float(sizes.abs().max()) <= 1.15
        assert (
            0.4 * hidden_effect.signed
            <= float((sizes < 0.0).double().mean())
            <= 0.6 * hidden_effect.signed
        )


def test_the_documented_sizes_are_those_that_are_hidden() -> None:
    lines = (HERE.parents[1] / "docs" / "effects.md").read_text(encoding="utf-8").splitlines()
    for name, effect in GENERATORS.items():
        start = (
            f"| {name} | {effect.law} | {'' if effect.unit == '1' else effect.unit} |"
            f" {effect.matters:g} | "
        )
        assert sum(line.startswith(start) for line in lines) == 1, start
