# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Model files: the shipped ones load anywhere, wrong and damaged ones are refused by name."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from torch import Tensor

from rover_parameters.records import ConfigError, build
from terrain_estimator.model.metadata import (
    DEFAULT_MODEL,
    MODELS,
    AddedEffect,
    ModelFileError,
    fingerprint,
    model_names,
)
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.packed_observation import packed_size
from terramechanics.presets import load_rover, load_soil

# What a program in another language would do, with torch alone: no package of this project, no
# NumPy of ours.
BARE = """
import sys, torch
model = torch.jit.load(sys.argv[1])
state = model.initial()
observation = torch.tensor([float(x) for x in sys.argv[2].split(",")], dtype=torch.float64)
with torch.jit.optimized_execution(False):  # as the nodes do
    for _ in range(25):
        state = model.update(state, observation)
print(*model.estimate(state).flatten().tolist(), *model.predict(state, observation).tolist())
packages = {name.split(".")[0] for name in sys.modules}
assert not packages & {"terrain_estimator", "terramechanics", "rclpy"}
"""
STEADY = [
    0.1,
    0.2,
    0.15,
    *[0.01] * 3,
    *[0.018] * 3,
    *[0.001] * 3,
    0.02,
    0.0,
    0.01,
    *[0.005] * 3,
    5.0,
    6.0,
    5.0,
    *[0.2] * 3,
]
STEADY += [0.2, 0.01, 0.03, 0.005, 0.1, 0.02, 0.0, 0.1, 1.0]


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A copy of a shipped model that a test may damage."""
    for suffix in (".pt", ".json"):
        shutil.copy(MODELS / f"{model_names()[0]}{suffix}", tmp_path / f"model{suffix}")
    return tmp_path / "model.pt"


@pytest.mark.parametrize("name", model_names())
def test_a_shipped_model_is_small_and_says_what_it_is_for(name: str) -> None:
    model = load_model(name)
    assert (MODELS / f"{name}.pt").stat().st_size < 1_000_000
    assert model.rover == load_rover(model.rover.name)
    assert model.metadata.soils == tuple(load_soil(soil.name) for soil in model.metadata.soils)
    assert torch.equal(
        getattr(model.module.physics, "nominal", model.module.physics).constants,
        torch.stack([soil.constants() for soil in model.metadata.soils]),
    )


def test_the_prior_deviation_of_an_effect_is_above_zero() -> None:
    effect = {"name": "drive_drag", "unit": "N m", "mean": 0.0}
    assert build(AddedEffect, effect | {"sd": 1e-3}, "effect").sd == 1e-3
    with pytest.raises(ConfigError, match="effect: sd: 0 is outside its range"):
        build(AddedEffect, effect | {"sd": 0.0}, "effect")


def test_a_model_runs_in_an_interpreter_with_torch_alone(tmp_path: Path) -> None:
    path = MODELS / f"{DEFAULT_MODEL}.pt"
    assert len(STEADY) == packed_size(3)
    command = [
        sys.executable,
        "-I",
        "-W",
        "ignore",
        "-c",
        BARE,
        str(path),
        ",".join(map(str, STEADY)),
    ]
    threads = {
        "OMP_NUM_THREADS": str(torch.get_num_threads())
    }  # sums of another number of threads differ in the last digits
    bare = subprocess.run(
        command, check=True, capture_output=True, text=True, cwd=tmp_path, env=os.environ | threads
    ).stdout.split()
    module = load_model().module
    state = module.initial()
    observation = torch.tensor(STEADY, dtype=torch.float64)
    for _ in range(25):
        state = module.update(state, observation)
    here = [
        *module.estimate(state).flatten().tolist(),
        *module.predict(state, observation).tolist(),
    ]
    assert [float(word) for word in bare] == pytest.approx(here, rel=1e-12)


def test_one_flipped_byte_is_found(copied: Path) -> None:
    content = bytearray(copied.read_bytes())
    content[len(content) // 2] ^= 1
    copied.write_bytes(content)
    with pytest.raises(ModelFileError, match=r"model\.pt: sha256 is .* damaged"):
        load_model(str(copied))


def test_a_cut_file_is_found_by_its_size(copied: Path) -> None:
    copied.write_bytes(copied.read_bytes()[:-100])
    with pytest.raises(ModelFileError, match=r"model\.pt: has \d+ bytes, model\.json says \d+"):
        load_model(str(copied))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": 99}, "format is 99"),
        ({"sise": 1}, "unknown key 'sise'"),
        ({"size": "big"}, "size"),
        ({"observation_scalar_fields": ["velocity"]}, "train it again"),
        ({"parameters": ["cohesion_kpa"]}, "parameters"),
    ],
)
def test_wrong_metadata_is_refused_by_name(
    copied: Path, change: dict[str, object], words: str
) -> None:
    sidecar = copied.with_suffix(".json")
    sidecar.write_text(json.dumps(json.loads(sidecar.read_text()) | change))
    with pytest.raises(ModelFileError, match=words):
        load_model(str(copied))


def test_a_missing_sidecar_and_an_unknown_name_are_refused(copied: Path) -> None:
    copied.with_suffix(".json").unlink()
    with pytest.raises(ModelFileError, match=r"model\.json: cannot be read"):
        load_model(str(copied))
    with pytest.raises(
        ModelFileError,
        match=(
            r"no such file; give the path of a .pt file, or an installed model: mars_rover,"
            r" mars_rover_on_varying_ground, mars_rover_with_net, paper_rover,"
            r" paper_rover_on_varying_ground, paper_rover_with_net"
        ),
    ):
        load_model("moon_rover")


def test_a_foreign_torchscript_module_is_refused(copied: Path) -> None:
    torch.jit.save(torch.jit.script(torch.nn.Linear(2, 2)), str(copied))
    sidecar = copied.with_suffix(".json")
    sha256, size = fingerprint(copied)
    sidecar.write_text(
        json.dumps(json.loads(sidecar.read_text()) | {"sha256": sha256, "size": size})
    )
    with pytest.raises(ModelFileError, match="has no method 'initial'"):
        load_model(str(copied))


class OtherArguments(torch.nn.Module):
    """A module with the methods of a model, of which one takes something else."""

    @torch.jit.export
    def initial(self) -> dict[str, Tensor]:
        return {}

    @torch.jit.export
    def initial_with_prior(self, mean: Tensor) -> dict[str, Tensor]:
        return {"mean": mean}

    @torch.jit.export
    def update(self, state: dict[str, Tensor], observation: Tensor) -> dict[str, Tensor]:
        del observation
        return state

    @torch.jit.export
    def discard(self, state: dict[str, Tensor]) -> dict[str, Tensor]:
        return state

    @torch.jit.export
    def predict(self, state: dict[str, Tensor], observation: Tensor) -> Tensor:  # noqa: ARG002
        return observation

    @torch.jit.export
    def estimate(self, state: dict[str, Tensor]) -> Tensor:
        return state["mean"]

    @torch.jit.export
    def effects(self, state: dict[str, Tensor]) -> Tensor:
        return state["mean"]


def test_a_module_whose_methods_take_something_else_is_refused_before_one_is_called(
    copied: Path,
) -> None:
    torch.jit.save(torch.jit.script(OtherArguments()), str(copied))
    sidecar = copied.with_suffix(".json")
    sha256, size = fingerprint(copied)
    sidecar.write_text(
        json.dumps(json.loads(sidecar.read_text()) | {"sha256": sha256, "size": size})
    )
    with pytest.raises(
        ModelFileError,
        match=(
            r"method initial_with_prior takes \(Tensor mean\), this version needs \(Tensor mean,"
            r" Tensor sd"
        ),
    ):
        load_model(str(copied))
