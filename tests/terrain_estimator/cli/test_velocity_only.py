# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Runs with slip, sinkage and velocity alone, by the commands of docs/bring_your_own_data.md."""

import csv
import json
from pathlib import Path

import pytest
import torch

from terrain_estimator.cli import csv_to_bag, find_missing_effect, replay
from terramechanics.presets import load_rover, load_soil
from terramechanics.simulation.sample import Measurement
from terramechanics.simulation.sensors import Noise, measure_drive, per_wheel
from terramechanics.simulation.simulation import simulate
from terramechanics.terrain.ground import Ground, Patch

MAPPING = Path(__file__).parents[3] / "docs" / "examples" / "velocity_only.yaml"
ROVER, SOIL = load_rover("mars_rover"), load_soil("loose_sand")
STRENGTH = ((2500.0, 0.55), (1500.0, 0.65))
"""c [Pa] and tan phi of two drives."""


def write_csv(path: Path, seen: Measurement, drive: int) -> None:
    """Write slip, sinkage and velocity of one drive, in SI units."""
    names = ROVER.wheel_names
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        wheels = [*(f"slip_{name}" for name in names), *(f"z_{name}" for name in names)]
        table.writerow(["t", "v", *wheels])
        for k in range(seen.velocity.shape[1]):
            values = [*seen.slip[drive, k].tolist(), *seen.sinkage[drive, k].tolist()]
            table.writerow([f"{0.1 * k:.1f}", float(seen.velocity[drive, k]), *values])


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Return bags of two level drives of 40 s."""
    folder = tmp_path_factory.mktemp("velocity")
    generator = torch.Generator().manual_seed(53)
    ground = Ground([Patch(SOIL.constants(), torch.tensor(STRENGTH, dtype=torch.float64))])
    drive = simulate(ROVER, ground, "S1", 40.0, generator, 2, "flat")
    seen = measure_drive(ROVER, per_wheel(ROVER, drive.seen), Noise(), generator)
    found = []
    for number in range(len(STRENGTH)):
        data, bag = folder / f"run_{number}.csv", folder / f"run_{number}"
        write_csv(data, seen, number)
        arguments = [str(data), "--mapping", str(MAPPING), "--out", str(bag)]
        assert csv_to_bag.main(arguments) == 0
        found.append(str(bag))
    return found


def test_replay_estimates_from_slip_sinkage_and_velocity_alone(
    bags: list[str], tmp_path: Path
) -> None:
    assert replay.main([*bags, "-p", "prior.soil:=loose_sand", "--out", str(tmp_path)]) == 0
    told = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    for run, truth in zip(told["bags"], STRENGTH, strict=True):
        assert run["status"] == "DEGRADED"  # it lacks rows
        assert run["seconds_taken"] == 40
        for name, value in zip(("cohesion_pa", "tan_phi"), truth, strict=True):
            found = run["estimate"][name]
            assert found["lower_95"] < value < found["upper_95"]
            assert found["sd"] < {"cohesion_pa": 1200.0, "tan_phi": 0.12}[name]


def test_the_search_gives_c_and_tan_phi_of_such_runs_and_finds_nothing_missing(
    bags: list[str], tmp_path: Path
) -> None:
    library = ["--library", "slip_sinkage,slope_bias"]
    assert find_missing_effect.main([*bags, *library, "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "finding.json").read_text(encoding="utf-8"))
    assert found["verdict"] == "none"
    before = found["parameters"]["before"]
    for k, (cohesion, friction) in enumerate(STRENGTH):
        assert before["cohesion_pa"][k] == pytest.approx(cohesion, abs=2500.0)
        assert before["tan_phi"][k] == pytest.approx(friction, abs=0.25)
