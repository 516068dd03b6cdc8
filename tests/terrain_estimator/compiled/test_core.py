# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The compiled cores of the models that ship against TorchScript, and the refusals of others."""

import dataclasses
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch

from terrain_estimator.cli import export_core
from terrain_estimator.compiled.core import CompiledModel, CoreError
from terrain_estimator.compiled.finding import MOST_DIFFERENCE, PLAIN, WIDE, ends_here, find_core
from terrain_estimator.compiled.fixed.forms import FUNCTIONS
from terrain_estimator.compiled.folder import MODEL, build_core
from terrain_estimator.compiled.runtime import CompiledRuntime
from terrain_estimator.compiled.source import answers, recorded_drive
from terrain_estimator.config.estimator import CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.learning.adding import Sized, add_effects
from terrain_estimator.learning.by_wheel import build_model_by_wheel
from terrain_estimator.learning.export import export
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import Training, model_names, model_path
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.prior import DEFAULT_PRIOR
from terrain_estimator.model.torchscript import running
from terrain_estimator.observation import Observation
from terrain_estimator.update import Update
from terramechanics.presets import load_rover, load_soil
from terramechanics.vehicle.wheel_places import WheelPlaces
from tests.rovers import FOUR_WHEELS
from tests.terrain_estimator.compiled.built_cores import BUILT, needs_core
from tests.terrain_estimator.drives import drive_observations
from tests.terrain_estimator.kinds import exported

pytestmark = needs_core


@pytest.fixture(scope="module", params=model_names())
def model(request: pytest.FixtureRequest) -> LoadedModel:
    return load_model(request.param)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the exported core of mars_rover, not compiled."""
    folder = tmp_path_factory.mktemp("exported") / "core"
    assert export_core.main(["mars_rover", str(folder)]) == 0
    return folder


@pytest.fixture(scope="module")
def four_wheels(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a model of two axles without a joint, and its exported core, not compiled."""
    written = tmp_path_factory.mktemp("four_wheels")
    model = exported(FOUR_WHEELS, written)
    assert export_core.main([str(model), str(written / "core")]) == 0
    return model, written / "core"


def observed_drive(seconds: float) -> list[Observation]:
    model = load_model("mars_rover")
    return drive_observations(model.rover, model.metadata.soils[0], seconds, seed=11)


def with_core(model: LoadedModel, name: str) -> LoadedModel:
    core = find_core(model_path(name), model.sha256)
    return dataclasses.replace(model, runtime=CompiledRuntime(core))


def name_of(model: LoadedModel) -> str:
    return next(name for name in model_names() if load_model(name).sha256 == model.sha256)


def same(a: Update, b: Update) -> None:
    """Check that two answers are one to MOST_DIFFERENCE of a deviation."""
    assert a.decision.outcome == b.decision.outcome
    assert a.decision.rows_used == b.decision.rows_used
    deviation = np.sqrt(np.diagonal(a.estimate.covariance))
    assert np.max(np.abs(a.estimate.mean - b.estimate.mean) / deviation) <= 10 * MOST_DIFFERENCE
    apart = (a.estimate.covariance - b.estimate.covariance) / np.outer(deviation, deviation)
    assert np.max(np.abs(apart)) <= 10 * MOST_DIFFERENCE
    np.testing.assert_allclose(
        a.estimate.soil_probability, b.estimate.soil_probability, rtol=0.0, atol=1e-8
    )
    np.testing.assert_allclose(a.prediction.velocity, b.prediction.velocity, rtol=0.0, atol=1e-11)


def test_a_core_is_found_and_agrees_with_torchscript(model: LoadedModel) -> None:
    core = find_core(model_path(name_of(model)), model.sha256)
    assert core.identity == model.sha256
    assert core.difference() <= MOST_DIFFERENCE


def test_every_tensor_of_the_state_has_torchs_size_and_value(model: LoadedModel) -> None:
    core = find_core(model_path(name_of(model)), model.sha256)
    module, here = model.module, core.initial()
    with running():
        there = module.initial()
        for packed in recorded_drive(model.metadata):
            there, here = module.update(there, packed), core.update(here, packed.numpy())
            assert set(here) == set(there)
            for name, value in there.items():
                assert here[name].shape == tuple(value.shape)
                assert here[name].dtype == value.numpy().dtype
        for name, value in there.items():
            given = value.double().numpy()
            scale = np.nanmax(np.abs(given), initial=0.0)
            np.testing.assert_allclose(
                here[name], given, rtol=1e-6, atol=1e-8 * scale, err_msg=name
            )
        closed = core.discard(here)
        assert closed["block"].shape[0] == 0
        assert here["block"].shape[0] == there["block"].shape[0]
        packed = recorded_drive(model.metadata)[-1]
        np.testing.assert_allclose(
            core.predict(here, packed.numpy()), module.predict(there, packed).numpy(), rtol=1e-9
        )
        np.testing.assert_allclose(core.estimate(here), module.estimate(there).numpy(), rtol=1e-8)
        assert core.effects(here).shape == tuple(module.effects(there).shape)


def test_the_recorded_answers_do_not_depend_on_the_number_of_threads() -> None:
    model, threads = load_model("mars_rover"), torch.get_num_threads()
    found = []
    try:
        for count in (1, 2):
            torch.set_num_threads(count)
            found.append(answers(model, recorded_drive(model.metadata)))
            assert torch.get_num_threads() == count
    finally:
        torch.set_num_threads(threads)
    assert found[0].numpy().tobytes() == found[1].numpy().tobytes()


def test_the_estimator_answers_the_same_with_a_core() -> None:
    plain = load_model("mars_rover")
    one = Estimator(plain, CoreConfig())
    other = Estimator(with_core(plain, "mars_rover"), CoreConfig())
    for observation in hostile(observed_drive(60.0)):
        same(one.update(observation), other.update(observation))


def hostile(drive: list[Observation]) -> list[Observation]:
    """Return a drive with a gap, lost signals, absurd values and wheels out of range."""
    changed = drive[:150] + drive[170:]
    for place, change in (
        (30, {"slip": np.array([0.1, math.nan, 0.2])}),
        (55, {"torque": np.full(3, math.nan), "acceleration": math.nan}),
        (80, {"sinkage": np.array([0.5, 0.5, 0.5])}),
        (95, {"velocity": 3.0}),
        (96, {"velocity": -2.0}),
        (120, {"bogie_angle": math.nan}),
        (200, {"slip": np.array([-0.4, -0.3, -0.5])}),
        (260, {"sinkage": np.array([1e-9, 0.0, 0.01])}),
    ):
        changed[place] = dataclasses.replace(changed[place], **change)
    return changed


def test_a_core_goes_on_from_a_state_that_was_saved() -> None:
    plain = load_model("mars_rover")
    drive = observed_drive(20.0)
    compiled = with_core(plain, "mars_rover")
    whole, first, second = (Estimator(compiled, CoreConfig()) for _ in range(3))
    for observation in drive[:105]:
        whole.update(observation)
        first.update(observation)
    second.restore(first.save())
    for observation in drive[105:]:
        a, b = whole.update(observation), second.update(observation)
        np.testing.assert_array_equal(a.estimate.mean, b.estimate.mean)
        np.testing.assert_array_equal(a.estimate.covariance, b.estimate.covariance)


@pytest.mark.parametrize("end", WIDE)
def test_wider_registers_give_the_same_bytes(end: str) -> None:
    both = [BUILT / f"mars_rover{each}" for each in (PLAIN, end)]
    if not both[1].is_file() or end not in ends_here():
        pytest.skip(f"this processor has not {' '.join(WIDE[end])}")
    drive = recorded_drive(load_model("mars_rover").metadata).numpy()
    states = []
    for path in both:
        core = CompiledModel(path)
        after, _ = core.run(core.initial(), drive, ["forecast"], 1)
        states.append(after)
    for name in states[0]:
        assert states[0][name].tobytes() == states[1][name].tobytes(), name


def test_the_widest_registers_that_a_processor_has_are_taken(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def ends(flags: str) -> list[str]:
        monkeypatch.setattr(Path, "read_text", lambda *_, **__: f"flags\t\t: fpu {flags}\n")
        return ends_here()

    assert ends("sse2") == [".so"]
    assert ends("sse2 avx2 avx512f") == [".avx2.so", ".so"]
    assert ends("sse2 avx2 avx512f avx512dq avx512vl") == [".avx512.so", ".avx2.so", ".so"]


def test_general_forms_give_the_bytes_of_fixed_ones(folder: Path, tmp_path: Path) -> None:
    written = (folder / MODEL).read_text()
    general = [name for name in FUNCTIONS if f" {name}_fixed_0(" not in written]
    assert general == ["learnt"]  # without a net it returns a tensor of no elements
    build_core(folder, tmp_path / "general.so", "-O1", "-DTERRAIN_GENERAL")
    plain = load_model("mars_rover")
    unfixed = CompiledRuntime(CompiledModel(tmp_path / "general.so"))
    one = Estimator(with_core(plain, "mars_rover"), CoreConfig())
    other = Estimator(dataclasses.replace(plain, runtime=unfixed), CoreConfig())
    hypotheses = set()
    for observation in hostile(observed_drive(60.0)):
        one.update(observation)
        other.update(observation)
        fixed, whole = one.save(), other.save()
        assert fixed.keys() == whole.keys()
        assert [n for n in fixed if fixed[n].tobytes() != whole[n].tobytes()] == []
        hypotheses.add(len(fixed["state.mean"]))
    assert len(hypotheses) > 2  # sizes that a form leaves open


def test_a_run_gives_what_single_updates_give() -> None:
    model = load_model("mars_rover")
    core = find_core(model_path("mars_rover"), model.sha256)
    drive = recorded_drive(model.metadata).numpy()
    after, told = core.run(core.initial(), drive, ["forecast", "strength_mean"], 3)
    state = core.initial()
    for packed, row in zip(drive, told, strict=True):
        state = core.update(state, packed)
        np.testing.assert_array_equal(row, [state["forecast"].item(), *state["strength_mean"]])
    assert after["mean"].tobytes() == state["mean"].tobytes()


def test_what_cannot_be_done_says_why() -> None:
    model = load_model("mars_rover")
    core = find_core(model_path("mars_rover"), model.sha256)
    with pytest.raises(CoreError, match="out of range"):
        core.update(core.initial(), np.zeros(7))
    with pytest.raises(KeyError, match="nothing"):
        core.initial()["nothing"]


def test_a_core_of_another_model_is_refused(tmp_path: Path) -> None:
    shutil.copy(BUILT / "paper_rover.so", tmp_path / "mars_rover.so")
    path = tmp_path / "mars_rover.pt"
    with pytest.raises(CoreError, match=r"made from the model .* build it anew"):
        _only_beside(path, load_model("mars_rover").sha256)


def test_a_library_that_is_no_core_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mars_rover.so").write_bytes(b"\x7fELF nothing")
    with pytest.raises(CoreError, match="not a compiled model"):
        _only_beside(tmp_path / "mars_rover.pt", "0" * 64)


def test_a_model_without_a_core_says_what_makes_one(tmp_path: Path) -> None:
    command = f"ros2 run terrain_estimator export_core {tmp_path}/mine.pt FOLDER --build"
    with pytest.raises(CoreError, match=command):
        _only_beside(tmp_path / "mine.pt", "0" * 64)


def _only_beside(path: Path, sha256: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("AMENT_PREFIX_PATH")
        find_core(path, sha256)


def by_wheel(folder: Path, torque_sd: tuple[float, ...] = (0.1,)) -> Path:
    """Write a model of six free wheels.

    With a deviation, it has a gain of the torques, and ground that varies.
    """
    rover, soil, path = load_rover("mars_rover"), load_soil("loose_sand"), folder / "by_wheel.pt"
    places = WheelPlaces.of(rover, 1.0, rover.wheel_names)
    prior = dataclasses.replace(DEFAULT_PRIOR, ground_variation=0.02 if torque_sd else 0.0)
    model = build_model_by_wheel(rover, places, [soil], prior, torque_sd)
    export(model, rover, [soil], Training(0, 0, 0.0, torch.__version__), path, places)
    return path


def by_wheel_with_effect(folder: Path) -> Path:
    """Write a model of six free wheels with a wedge of soil ahead of each."""
    plain, path = load_model(str(by_wheel(folder, ()))), folder / "with_effect.pt"
    add_effects(plain, [Sized.of_library("bulldozing")], path)
    return path


@pytest.mark.parametrize("kind", ["mars_rover", "four_wheels", "by_wheel", "by_wheel_with_effect"])
def test_an_exported_folder_builds_and_checks_itself(
    folder: Path, four_wheels: tuple[Path, Path], tmp_path: Path, kind: str
) -> None:
    """Of a model that ships, of one with two axles and without a joint, and of single wheels."""
    place, name = tmp_path / "core", kind
    if kind.startswith("by_wheel"):
        path = by_wheel(tmp_path) if kind == "by_wheel" else by_wheel_with_effect(tmp_path)
        name = str(path)
        assert export_core.main([name, str(place)]) == 0
    elif kind == "four_wheels":
        name = str(four_wheels[0])
        shutil.copytree(four_wheels[1], place)
    else:
        shutil.copytree(folder, place)
    (place / "compile_flags.txt").write_text("-std=c++17\n-O0\n-ffp-contract=off\n")
    for command in (["cmake", "-B", "build"], ["cmake", "--build", "build"]):
        subprocess.run(command, cwd=place, check=True, capture_output=True)
    done = subprocess.run(["build/check"], cwd=place, check=True, capture_output=True, text=True)
    model = load_model(name)
    assert model.sha256[:16] in done.stdout
    core, there = CompiledModel(place / "build" / "libterrain_core.so"), model.module.initial()
    here = core.initial()
    assert core.difference() <= MOST_DIFFERENCE
    with running():
        for packed in recorded_drive(model.metadata)[:25]:
            there, here = model.module.update(there, packed), core.update(here, packed.numpy())
        for key, value in there.items():
            given, shape = value.double().numpy(), tuple(value.shape)
            scale = np.nanmax(np.abs(given), initial=0.0)
            assert here[key].shape == shape
            np.testing.assert_allclose(here[key], given, rtol=1e-6, atol=1e-8 * scale, err_msg=key)


CROSS, QEMU = shutil.which("aarch64-linux-gnu-g++"), shutil.which("qemu-aarch64")


@pytest.mark.skipif(
    not (CROSS and QEMU), reason="needs Debian's g++-aarch64-linux-gnu and qemu-user"
)
@pytest.mark.parametrize("wheels", [4, 6])
def test_another_processor_gives_the_same_bytes(
    folder: Path, four_wheels: tuple[Path, Path], tmp_path: Path, wheels: int
) -> None:
    """The checksum of all numbers of the recorded drive, and the difference from TorchScript."""
    source, said = folder if wheels == 6 else four_wheels[1], []
    for compiler, runner in (("g++", []), (str(CROSS), [str(QEMU)])):
        program = tmp_path / Path(compiler).name
        flags = ["-std=c++17", "-O0", "-ffp-contract=off", "-static", f"-I{source}"]
        parts = [str(source / name) for name in ("check.cpp", "model.cpp")]
        subprocess.run([compiler, *flags, "-o", str(program), *parts], check=True)
        done = subprocess.run([*runner, str(program)], check=True, capture_output=True, text=True)
        said.append(done.stdout)
    assert "checksum" in said[0]
    assert said[0] == said[1]


def test_export_core_refuses_a_folder_that_is_not_empty(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine").write_text("kept")
    assert export_core.main(["mars_rover", str(tmp_path)]) == export_core.WRONG
    assert "not empty" in capsys.readouterr().err
    assert (tmp_path / "mine").read_text() == "kept"


def test_export_core_refuses_what_is_no_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "none.pt"
    torch.save({}, path)
    assert export_core.main([str(path), str(tmp_path / "out")]) == export_core.WRONG
    assert "none.json" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
