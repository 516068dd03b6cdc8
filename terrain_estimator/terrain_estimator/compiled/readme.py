# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The README of an exported core: the layout of an observation of this model, and how to use it."""

import textwrap
from collections.abc import Iterator
from typing import NamedTuple

from terrain_estimator.model.metadata import Metadata
from terrain_estimator.model.packed_observation import BLOCK, LONGEST_GAP


class Part(NamedTuple):
    """Numbers of one kind in a packed observation, from ``first`` on."""

    first: int
    size: int
    name: str
    unit: str
    content: str


_CONTENT = {
    "slip": ("1", "1 - v / (r w), of the ground speed v and the speed r w of the rim"),
    "sinkage": ("m", "depth of the wheel in the ground"),
    "contact_angle": ("rad", "of the ground from the body, positive where it climbs"),
    "torque": ("N m", "of one wheel, on the ground: the motor's less wheel inertia times dw/dt"),
    "velocity": ("m/s", "along body x"),
    "pitch": ("rad", "nose up (the negative of REP 103)"),
    "acceleration": ("m/s^2", "specific force along body x: dv/dt + g sin(pitch)"),
    "bogie_angle": ("rad", "of the bogie from the body, nose up"),
    "wheel_rate": ("rad/s", "w; where it is NaN, give NaN as slip, too"),
    "rim": ("m/s", "r w"),
    "steering": ("rad", "to the left; 0 where nothing steers the wheel"),
    "lateral_velocity": ("m/s", "along body y, to the left"),
    "yaw_rate": ("rad/s", "to the left"),
    "roll": ("rad", "of body y above the horizon, left side up"),
    "step": ("s", "since the last observation that was used; {step:g} where there is none"),
    "linked": ("1", "1 where that one was used and `step` is at most {gap:g} s, else 0"),
}
"""Unit and content by name; a deviation has the unit of what it belongs to."""
_TURNING_PITCH = (
    "nose up, corrected for the turn: asin(sin(pitch) - w (v_y + x w) / g) with the yaw rate w, the"
    " lateral velocity v_y and the centre of mass x ahead of the body's origin"
)
_TEXT = """# {model_id} as C++

Made from the TorchScript file with SHA-256 {sha256}.
It needs GCC or Clang with C++17 and nothing else; `terrain_core.h` says what each function does.

    cmake -B build && cmake --build build && ctest --test-dir build

## The numbers of an observation

`packed` holds {size} doubles in SI units. NaN stands for "not measured".

| numbers | name | unit | content |
|---|---|---|---|
{rows}

{values}

The model was trained for an observation every {step:g} s; {block} of them make a block. The
estimate of the ground changes when a block closes, the velocity with every observation. The core
screens nothing: gates, averaging of faster readings and the judgement of the estimate are in the
Python around it.

## What comes out

- `terrain_estimate()`: c [Pa] and tan phi [1].
- `terrain_effects()`: {effects}.
- The tensor `soils`: the probability of each soil, in the order of `terrain_initial_with_prior()`:
  {soils}.

Tensors of the state have the model's own units (c in kPa). They are for saving and restoring.

## A state that is saved and restored

    TerrainState* restored = terrain_empty();
    for (int64_t key = 0; terrain_name(key); ++key) {{
      int64_t sizes[8], kind, dimensions = terrain_shape(state, key, sizes, &kind);
      if (dimensions < 0) continue; /* a state has not every tensor */
      if (terrain_read(state, &key, 1, numbers, room) < 0) return 1; /* more numbers than room */
      if (terrain_put(restored, key, numbers, sizes, dimensions, kind) < 0) return 1;
    }}

Between reading and putting, `numbers`, `sizes`, `dimensions` and `kind` may be in a file, with the
name of the tensor and `terrain_model()`. The restored state goes on with the same bytes.
"""


def layout(metadata: Metadata) -> Iterator[Part]:
    """Yield the parts of a packed observation of a model, in their order without a gap."""
    wheels, first, unit = metadata.stations, 0, ""
    facts = {"step": metadata.step_s, "gap": LONGEST_GAP * metadata.step_s}
    by_wheel = metadata.wheel_places is not None
    counts = dict.fromkeys(metadata.observation_axle_fields, wheels)
    for name in metadata.observation_scalar_fields:
        kind, _, number = name.rpartition("_")
        kind = kind if number.isdigit() else name  # one number of each wheel
        counts[kind] = counts.get(kind, 0) + 1
    for name, count in counts.items():
        content = f"deviation of {name.removesuffix('_sd')}"
        if not name.endswith("_sd"):
            unit, content = _CONTENT[name]
            content = _TURNING_PITCH if by_wheel and name == "pitch" else content
        yield Part(first, count, name, unit, content.format(**facts))
        first += count


def readme(metadata: Metadata) -> str:
    """Return the README of the core of a model."""
    parts = list(layout(metadata))
    rows = "\n".join(
        f"| {_places(part)} | `{part.name}` | {part.unit} | {part.content} |" for part in parts
    )
    listed = ", ".join(f"size of {each.name} [{each.unit}]" for each in metadata.effects)
    return _TEXT.format(
        model_id=metadata.model_id,
        sha256=metadata.sha256,
        size=parts[-1].first + parts[-1].size,
        rows=rows,
        values=textwrap.fill(_values(metadata), 100),
        step=metadata.step_s,
        block=BLOCK,
        effects=listed or "none, this model has no named effects",
        soils=", ".join(soil.name for soil in metadata.soils),
    )


def _values(metadata: Metadata) -> str:
    """Return whose the values are, and which are required."""
    if metadata.wheel_places is None:
        whose, what = "axles, front to rear", "velocity and pitch, and of every axle slip and"
    else:
        whose = f"wheels: {', '.join(metadata.wheels)}"
        what = "velocity, lateral velocity, yaw rate, pitch and roll, and of every wheel rim,"
        what += " steering, slip and"
    sinkage = "So are the sinkages."
    if metadata.balances_sinkage:
        sinkage = (
            "So are the sinkages, unless all torques and the angle of a bogie are measured: then"
            " give NaN for all of them."
        )
    return (
        f"Values are those of {whose}. Every deviation is one standard deviation. Required are"
        f" {what} contact angle, with their deviations. {sinkage}"
    )


def _places(part: Part) -> str:
    last = part.first + part.size - 1
    return str(part.first) if part.size == 1 else f"{part.first} to {last}"
