# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Models on a soil with the contact law scm: their rows, their files, and what they refuse."""

from pathlib import Path

import pytest
import torch

from rover_parameters.records import ConfigError
from terrain_estimator.compiled.source import cpp_of
from terrain_estimator.learning.adding import Sized, add_effects, with_effects
from terrain_estimator.learning.export import check_export, export
from terrain_estimator.learning.restore import physics_alone, restore
from terrain_estimator.learning.tasks import measure_tasks
from terrain_estimator.learning.training import build_model
from terrain_estimator.model.loaded import LoadedModel
from terrain_estimator.model.metadata import Training
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.palpaca import PAlpaca
from terrain_estimator.model.physics_by_law import PhysicsByLaw
from terrain_estimator.model.physics_with_effects import PhysicsWithEffects, nominal_of
from terrain_estimator.model.rows import Rows, frame_of, regression_rows
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import Drive
from terramechanics.simulation.sensors import Noise
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground

ROVER, LOOSE = load_rover("mars_rover"), load_soil("loose_sand")
SCM_SAND = LOOSE.with_values(name="scm_sand", law="scm", c1=0.02, c2=0.0)
NOTHING_TRAINED = Training(0, 0, 0.0, torch.__version__)


@pytest.fixture(scope="module")
def drive() -> Drive:
    """Return a drive at a steady pace: what the wheels before left is what they leave now."""
    return simulate(
        ROVER, Ground.constant(SCM_SAND), "S3", 6.0, torch.Generator().manual_seed(2), 1, "flat"
    )


@pytest.fixture(scope="module")
def model() -> PAlpaca:
    return physics_alone(ROVER, SCM_SAND, exact=False)


@pytest.fixture(scope="module")
def file(model: PAlpaca, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scm") / "mars_rover-scm_sand.pt"
    export(model, ROVER, [SCM_SAND], NOTHING_TRAINED, path)
    return path


@pytest.fixture(scope="module")
def loaded(file: Path) -> LoadedModel:
    return load_model(str(file))


def left(rows: Rows, drive: Drive) -> torch.Tensor:
    """Return what is left of rows at the true c and tan phi, in the last second."""
    strength = drive.sample.strength[0, 0, 0]
    theta = torch.stack([strength[0] / 1000.0, strength[1], torch.ones_like(strength[0])])
    rest = (rows.features[0] @ theta - rows.target)[:, 1:]
    return rest[-10:].abs().amax(0)


def test_the_rows_of_an_exact_drive_hold_by_the_law_and_do_not_by_another(
    model: PAlpaca, drive: Drive
) -> None:
    packed = measure_tasks(drive, Noise(factor=0.0), torch.Generator().manual_seed(0)).measured[0]
    physics = model.physics
    assert isinstance(physics, PhysicsByLaw)
    contact = nominal_of(physics).nominal_contact()
    own = left(physics.rows_at(frame_of(packed, contact), packed, contact, None), drive)
    other = left(regression_rows(packed, packed, contact), drive)
    assert own.amax() < 5e-3
    assert other.amax() > 0.1


def test_the_file_gives_the_numbers_of_the_python_model(
    model: PAlpaca, file: Path, drive: Drive
) -> None:
    packed = measure_tasks(drive, Noise(), torch.Generator().manual_seed(0)).measured[0]
    check_export(model, file, packed[:40])


def test_the_soil_of_a_file_has_its_law_and_the_model_comes_back(loaded: LoadedModel) -> None:
    assert [soil.law for soil in loaded.metadata.soils] == ["scm"]
    assert isinstance(restore(loaded).physics, PhysicsByLaw)


def test_the_file_is_written_as_cpp(file: Path) -> None:
    assert "scm_forces" in cpp_of(file)


def test_effects_are_added_to_the_law(loaded: LoadedModel, tmp_path: Path) -> None:
    effect = Sized("slope_bias", 0.0, 0.02)
    physics = with_effects(loaded, [effect]).physics
    assert isinstance(physics, PhysicsWithEffects)
    assert physics.effect_rows.keeps_ruts
    add_effects(loaded, [effect], tmp_path / "more.pt")
    assert load_model(str(tmp_path / "more.pt")).effects


def test_the_law_as_an_effect_is_refused_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="train a model on a soil file with law: scm"):
        add_effects(load_model(), [Sized("contact_law_scm", 1.0, 0.3)], tmp_path / "law.pt")


def test_soils_of_two_laws_are_refused() -> None:
    with pytest.raises(
        ConfigError, match="one contact law, not scm and wong_reece: loose_sand has"
    ):
        build_model(ROVER, [LOOSE, SCM_SAND])
