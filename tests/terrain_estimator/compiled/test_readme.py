# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""An exported folder tells its user the truth: what an observation is, and how a state is saved."""

import dataclasses
import re
import shutil
import subprocess
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from terrain_estimator.compiled.core import _SIGNATURES
from terrain_estimator.compiled.folder import RUNTIME
from terrain_estimator.compiled.readme import layout, readme
from terrain_estimator.model.metadata import AddedEffect
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packed_observation import TurningBody, pack, scalar_fields
from terrain_estimator.observation import AXLE_FIELDS, SCALAR_FIELDS, Observation
from terramechanics.vehicle.wheel_places import WheelPlaces
from tests.terrain_estimator.compiled.built_cores import BUILT, needs_core

COMPILER = shutil.which("cc")
BY_AXLE = load_model("mars_rover").metadata
KINDS = {
    "by_axle": BY_AXLE,
    "with_an_effect": dataclasses.replace(
        BY_AXLE,
        observation_scalar_fields=scalar_fields(3, rates=True),
        effects=(AddedEffect("drive_drag", "1", 0.0, 0.1),),
    ),
    "by_wheel": dataclasses.replace(
        BY_AXLE,
        observation_scalar_fields=scalar_fields(6, rates=False, by_wheel=True),
        wheel_places=WheelPlaces.of(BY_AXLE.rover, 1.0, BY_AXLE.rover.wheel_names),
    ),
}
BODY = TurningBody(radius=0.25, gravity=3.71, centre_x=0.05)
STEP_S = 0.125


def numbered(stations: int) -> Observation:
    """Return an observation in which every number is another one."""
    arrays: dict[str, Any] = {
        name: 0.001 * (1 + place) + 0.0001 * np.arange(stations)
        for place, name in enumerate(AXLE_FIELDS)
    }
    scalars: dict[str, Any] = {
        name: 0.02 + 0.001 * place for place, name in enumerate(SCALAR_FIELDS)
    }
    steering = 0.03 + 0.0001 * np.arange(stations, dtype=np.float64)
    return Observation(stamp_ns=0, **arrays, **scalars, steering=steering)


@pytest.mark.parametrize("kind", KINDS)
def test_the_layout_names_every_number_that_the_estimator_packs(kind: str) -> None:
    metadata = KINDS[kind]
    seen = numbered(metadata.stations)
    body = BODY if metadata.wheel_places else None
    torque = (0.5 * seen.torque).tolist()
    packed = pack(seen, torque, STEP_S, linked=True, rates=bool(metadata.effects), body=body)
    other = {
        "torque": torque,
        "rim": BODY.radius * seen.wheel_rate,
        "pitch": BODY.pitch(seen) if body else seen.pitch,
        "step": STEP_S,
        "linked": 1.0,
    }
    at = 0
    for part in layout(metadata):
        value = other[part.name] if part.name in other else getattr(seen, part.name)
        expected = np.atleast_1d(value)
        assert part.first == at, part.name
        np.testing.assert_array_equal(packed[at : at + part.size], expected, err_msg=part.name)
        at += part.size
    assert at == packed.size
    assert f"`packed` holds {packed.size} doubles" in readme(metadata)


@pytest.mark.parametrize("kind", KINDS)
def test_the_readme_has_a_row_for_every_part_and_no_long_line_but_those(kind: str) -> None:
    metadata = KINDS[kind]
    lines = readme(metadata).splitlines()
    rows = [line for line in lines if line.startswith("| ") and "`" in line]
    assert [row.split("`")[1] for row in rows] == [part.name for part in layout(metadata)]
    assert all(len(line) <= 110 for line in lines if not line.startswith("|"))
    assert all(name in readme(metadata) for name in metadata.wheels)


def exported() -> set[str]:
    source = (RUNTIME / "interface.hpp").read_text()
    return set(re.findall(r"^TERRAIN_API [\w* ]*?(terrain_\w+)\(", source, re.MULTILINE))


def test_the_header_declares_every_function_that_a_core_exports() -> None:
    header = (RUNTIME / "terrain_core.h").read_text()
    declared = re.findall(r"^(?:const )?\w+\*? (terrain_\w+)\(", header, re.MULTILINE)
    assert len(declared) == len(set(declared))
    assert set(declared) == exported()
    assert exported() >= {f"terrain_{name}" for name in _SIGNATURES}, "what Python calls"


PROGRAM = """
#include <stdio.h>
#include <string.h>
#include "terrain_core.h"

static double numbers[1 << 20], others[1 << 20];
static const int64_t room = 1 << 20;

static int same(const TerrainState* a, const TerrainState* b) {
  for (int64_t key = 0; terrain_name(key); ++key) {
    const int64_t count = terrain_read(a, &key, 1, numbers, room);
    if (terrain_read(b, &key, 1, others, room) != count) return 0;
    if (count > 0 && memcmp(numbers, others, (size_t)count * sizeof(double))) return 0;
  }
  return 1;
}

int main(void) {
  int64_t observations, size;
  const double* drive = terrain_drive(&observations, &size);
  TerrainState* start = terrain_initial();
  TerrainState* state = terrain_run(start, drive, HALF, size, 0, 0, 0, 0);
SNIPPET
  if (!same(state, restored)) return 2;
  int changes = 0;
  for (int64_t k = HALF; k < observations; ++k) {
    TerrainState* one = terrain_update(state, drive + k * size, size);
    TerrainState* other = terrain_update(restored, drive + k * size, size);
    if (!one || !other || !same(one, other)) return 3;
    changes += !same(one, state);
    terrain_free(state);
    terrain_free(restored);
    state = one;
    restored = other;
  }
  TerrainState* whole = terrain_run(start, drive, observations, size, 0, 0, 0, 0);
  if (!same(whole, restored)) return 4;
  double estimate[6];
  if (terrain_estimate(restored, estimate) != 6) return 5;
  printf("%d %.17g %.17g\\n", changes, estimate[0], estimate[1]);
  return 0;
}
"""
HALF = 34  # in the middle of a block


@pytest.mark.skipif(not COMPILER, reason="needs a C compiler")
@needs_core
def test_a_c_program_restores_a_state_as_the_readme_says(tmp_path: Path) -> None:
    """Its header alone, as C: the restored state goes on with the same bytes."""
    text = readme(BY_AXLE)
    snippet = text[text.index("    TerrainState* restored") : text.index("Between reading")]
    program = PROGRAM.replace("HALF", str(HALF)).replace("SNIPPET", textwrap.dedent(snippet))
    (tmp_path / "restore.c").write_text(program)
    strict = ["-std=c11", "-Wall", "-Wextra", "-pedantic", "-Werror", f"-I{RUNTIME}"]
    core = BUILT / "mars_rover.so"
    command = [str(COMPILER), *strict, "restore.c", str(core), "-o", "restore"]
    subprocess.run(command, cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "restore"], check=True, capture_output=True, text=True)
    changes, cohesion, tan_phi = map(float, done.stdout.split())
    assert changes > 30, "the drive goes on"
    assert 100.0 < cohesion < 5000.0, "Pa"
    assert 0.2 < tan_phi < 1.2
