# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The C++ source of a model: its functions, its tensors, and a drive with TorchScript's answers."""

import math
from pathlib import Path

import torch
from torch import Tensor

from terrain_estimator.compiled.fixed.forms import FUNCTIONS, Samples, fixed_forms, with_forms
from terrain_estimator.compiled.graphs import Graphs, read_for_translation
from terrain_estimator.compiled.spelling import number
from terrain_estimator.compiled.translation import Translation
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import Metadata
from terrain_estimator.model.model_file import checked_model, load_model
from terrain_estimator.model.packed_observation import GROUPS, TIMING
from terrain_estimator.model.packing import pack_measurement, view_of, with_slip, without_link
from terrain_estimator.model.torchscript import running
from terramechanics.simulation.by_wheel import sample_by_wheel
from terramechanics.simulation.sample import TIME_STEP, Sample
from terramechanics.simulation.sensors import LATERAL_SD, YAW_RATE_SD, Noise, measure_drive
from terramechanics.simulation.simulation import simulate
from terramechanics.simulation.spatial import BodySimulation
from terramechanics.terrain.ground import Ground, Patch
from terramechanics.terrain.profile import STEEPEST
from terramechanics.terrain.surface import random_waves
from terramechanics.vehicle.chassis import Chassis
from terramechanics.vehicle.wheel_places import WheelPlaces, chassis_places, wheel_order

METHODS = (
    "initial",
    "initial_with_prior",
    "update",
    "discard",
    "predict",
    "estimate",
    "effects",
    "publish",
)
"""Methods of the model that a program calls."""
RECORDED_S = 7.0
"""[s] Length of the recorded drive."""
WATCHED_S = 20.0
"""[s] Length of the drive that is watched for sizes: until hypotheses have become fewer."""

_LEAN = 0.005
"""[rad] Deviation of the roll."""
_SWING, _STARTING = 0.3, 2.0
"""[1], [s] Swing of the speed of a rover that is not planar, and the time to reach it."""

HEAD = """\
// Made from {name}.pt by terrain_estimator.compiled; do not edit.
// One function for each of the model's TorchScript functions, with its branches and loops.
// clang-format off

#include "fixed.hpp"

namespace terrain::model {{
namespace {{

// SHA-256 of the TorchScript file
constexpr char kModel[] = "{identity}";
"""


def cpp_of(path: Path) -> str:
    """Return the C++ source of the model in a TorchScript file, which has its JSON file beside it.

    Raises:
        ModelFileError: the file is not a model of this package.
        UntranslatableError: the model has an operator without a C++ form, which the text names.
    """
    archive, metadata = checked_model(path)
    graphs = Graphs(read_for_translation(archive))
    translation = Translation(graphs)
    for method in METHODS:
        translation.method(method)
    drive = recorded_drive(metadata)
    parts = [
        HEAD.format(name=path.stem, identity=metadata.sha256),
        _keys(list(translation.keys)),
        _constants(translation.constants),
        _recorded(drive, answers(load_model(str(path)), drive)),
        "\n".join(translation.declarations) + "\n",
        *_functions(translation, graphs, watched_drive(metadata)),
        '}  // namespace\n}  // namespace terrain::model\n\n#include "interface.hpp"\n',
    ]
    return "\n".join(parts)


def _functions(translation: Translation, graphs: Graphs, drive: Tensor) -> list[str]:
    """Return the C++ of all functions: the fixed forms of some, which are tried first."""
    samples = Samples(graphs, drive)
    addresses = addresses_of(translation)
    written = []
    for name, body in translation.functions.items():
        head, forms = translation.heads[name], []
        if name in FUNCTIONS:
            paths, index = samples.of(name, graphs, addresses), samples.index(name)
            forms = fixed_forms(graphs, addresses, name, head, paths, index)
        written += [*forms, with_forms(name, head, body, len(forms))]
    return written


def addresses_of(translation: Translation) -> dict[int, str]:
    """Return the names of the tensors that are in the C++, by the address of their memory."""
    return {
        value.untyped_storage().data_ptr(): name
        for name, (value, _) in translation.constants.items()
        if value.is_contiguous() and value.storage_offset() == 0
    }


def watched_drive(metadata: Metadata) -> Tensor:
    """Return packed observations [n, P] of a plain drive on the first soil, without a fault."""
    return _packed_drive(metadata, WATCHED_S)


def recorded_drive(metadata: Metadata) -> Tensor:
    """Return packed observations [n, P] of a drive of the model's rover on its first soil.

    In it a link is missing, a wheel's slip, an acceleration, and for a second the sinkages, where
    the model can do without them.
    """
    packed = _packed_drive(metadata, RECORDED_S)
    packed = torch.cat([packed[:25], without_link(packed[25:26]), packed[26:]])
    view = view_of(packed, metadata.stations)
    slip = view.slip.clone()
    slip[45, 0] = torch.nan
    packed = with_slip(packed, slip)
    view = view_of(packed, metadata.stations)
    view.acceleration[52] = torch.nan
    if metadata.balances_sinkage:
        view.sinkage[55:65] = torch.nan
    return packed


def _packed_drive(metadata: Metadata, seconds: float) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    strength = torch.tensor([metadata.prior_mean], dtype=torch.float64)
    soil = metadata.soils[0]
    if metadata.wheel_places is not None and not metadata.rover.is_determined:
        sample = _spatial_drive(metadata, metadata.wheel_places, strength, seconds, generator)
        packed = pack_measurement(measure_drive(metadata.rover, sample, Noise(), generator))[0]
        return _moving(packed, metadata.rover.wheel_radius * sample.wheel_rate[0], generator)
    ground = Ground([Patch(soil.constants().unsqueeze(0), strength, name=soil.name, law=soil.law)])
    drive = simulate(metadata.rover, ground, "S1", seconds, generator, 1)
    packed = pack_measurement(measure_drive(metadata.rover, drive.seen, Noise(), generator))[0]
    rates = drive.sample.wheel_rate[0].expand(-1, metadata.rover.axles)
    if metadata.wheels:
        return _by_wheel(metadata, packed, rates, generator)
    if metadata.effects:
        place = packed.shape[1] - TIMING  # the rates stand before what is of the time
        packed = torch.cat([packed[:, :place], rates, packed[:, place:]], 1)
    return packed


def _by_wheel(
    metadata: Metadata, packed: Tensor, rates: Tensor, generator: torch.Generator
) -> Tensor:
    """Return a straight drive [n, P] by axle as one by wheel, with noise in how it moves aside."""
    rover = metadata.rover
    axles = [rover.wheels[k].axle for k in wheel_order(rover)]
    first = GROUPS * rover.axles
    wheels = packed[:, :first].reshape(-1, GROUPS, rover.axles)[:, :, axles].flatten(1)
    rims = rover.wheel_radius * rates[:, axles]
    return _moving(torch.cat([wheels, packed[:, first:]], 1), rims, generator)


def _spatial_drive(
    metadata: Metadata,
    places: WheelPlaces,
    strength: Tensor,
    seconds: float,
    generator: torch.Generator,
) -> Sample:
    """Return a straight drive over hills of a rover that is not planar, with a value a wheel."""
    rover = metadata.rover
    chassis = Chassis.of(rover, places.track_width, places.yaw_inertia)
    surface = random_waves(1, STEEPEST, generator)
    constants = metadata.soils[0].constants().unsqueeze(0)
    simulation = BodySimulation(chassis, constants, strength, surface=surface)
    straight = torch.zeros(1, chassis.wheels, dtype=torch.float64)
    cruise, driven = sum(rover.cruise_speed) / 2.0, []
    for step in range(1, round(seconds / TIME_STEP) + 1):
        swing = 1.0 + _SWING * math.sin(step * TIME_STEP)
        ramp = min(step * TIME_STEP / _STARTING, 1.0)
        driven.append(simulation.step(straight + cruise * swing * ramp, straight))
    in_chassis = chassis_places(rover)
    return sample_by_wheel(rover, driven, [in_chassis[k] for k in wheel_order(rover)])


def _moving(packed: Tensor, rims: Tensor, generator: torch.Generator) -> Tensor:
    """Return a straight drive [n, P] with rims [n, W] [m/s] and noise in how it moves aside."""
    first = GROUPS * rims.shape[1]
    noise = torch.randn(len(packed), 3, generator=generator, dtype=torch.float64)
    spreads = torch.tensor([LATERAL_SD, YAW_RATE_SD, _LEAN], dtype=torch.float64).expand_as(noise)
    lateral, turn, roll = (noise * spreads).unbind(1)
    of_lateral, of_turn, of_roll = spreads.unbind(1)
    moved = torch.stack([lateral, of_lateral, turn, of_turn, roll, of_roll], 1)
    wheels, rest = packed[:, :first], packed[:, first:]
    parts = [wheels, rest[:, :-TIMING], rims, torch.zeros_like(rims), moved, rest[:, -TIMING:]]
    return torch.cat(parts, 1)


def answers(model: LoadedModel, drive: Tensor) -> Tensor:
    """Return TorchScript's answers [n, 6] to a packed drive.

    Means and variances of c [kPa] and tan phi, then mean and variance of the velocity ahead.
    Runs on one thread, as the nodes do: the order of a sum is part of its result.
    """
    found, threads = [], torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with running():
            state = model.module.initial()
            for packed in drive:
                state = model.module.update(state, packed)
                variance = state["strength_covariance"].diagonal()
                ahead = torch.stack([state["forecast"], state["forecast_variance"]])
                found.append(torch.cat([state["strength_mean"], variance, ahead]))
    finally:
        torch.set_num_threads(threads)
    return torch.stack(found)


def _numbers(values: Tensor) -> str:
    return ", ".join(map(number, values.to(torch.float64).flatten().tolist()))


def _recorded(drive: Tensor, answered: Tensor) -> str:
    rows = ",\n".join(f"  {{{_numbers(row)}}}" for row in answered)
    return (
        "// A recorded drive, and what TorchScript answered to it: see terrain_check().\n"
        f"constexpr double kDrive[] = {{{_numbers(drive)}}};\n"
        f"constexpr double kAnswers[][{answered.shape[1]}] = {{\n{rows}\n}};\n"
    )


def _keys(names: list[str]) -> str:
    listed = ",\n".join(f"  {name}" for name in names)
    texts = ",\n".join(f'  "{name}"' for name in names)
    return (
        f"namespace key {{\nenum : int64_t {{\n{listed}\n}};\n}}  // namespace key\n"
        f"constexpr const char* kNames[] = {{\n{texts}\n}};\n"
    )


def _constants(constants: dict[str, tuple[Tensor, str]]) -> str:
    """Return the model's tensors as a structure that is made at the first use."""
    arrays, members = [], []
    for name, (value, kind) in constants.items():
        sizes = ", ".join(map(str, value.shape))
        arrays.append(f"constexpr double k_{name}[] = {{{_numbers(value) or '0.0'}}};")
        members.append(f"  const Tensor {name} = Tensor::of(k_{name}, {{{sizes}}}, Kind::{kind});")
    return (
        "\n".join(arrays)
        + "\n\nstruct Constants {\n"
        + "\n".join(members)
        + "\n};\nconst Constants& constants() {\n  static const Constants all;\n  return all;\n}\n"
    )
