# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A core that differs from TorchScript by more than a billionth of a deviation is not used.

The cores are built ones whose recorded answers are changed, so the core's own check judges them.
"""

import math
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from rover_parameters.records import ConfigError
from terrain_estimator.compiled.core import CoreError
from terrain_estimator.compiled.finding import MOST_DIFFERENCE, find_core, load
from terrain_estimator.config.estimator import AUTO, COMPILED, TORCHSCRIPT, CoreConfig
from terrain_estimator.estimator.estimator import Estimator
from terrain_estimator.model.model_file import load_model
from terrain_estimator.observation import Floats
from tests.terrain_estimator.compiled.altered_cores import altered, model_with_core
from tests.terrain_estimator.compiled.built_cores import BUILT, needs_core
from tests.terrain_estimator.drives import drive_observations

pytestmark = needs_core
Change = Callable[[Floats], object]


def shifted(column: int, deviations: float) -> Change:
    """Return a change that moves the last answer of c, tan phi or the velocity."""
    mean, variance = ((0, 2), (1, 3), (4, 5))[column]

    def change(answers: Floats) -> None:
        answers[-1, mean] += deviations * math.sqrt(answers[-1, variance])

    return change


def widened(answers: Floats) -> None:
    answers[-1, 3] *= 1.0 + 1e-8


def set_to(row: int, column: int, value: float) -> Change:
    def change(answers: Floats) -> None:
        answers[row, column] = value

    return change


@pytest.fixture(autouse=True)
def no_other_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AMENT_PREFIX_PATH")


@pytest.mark.parametrize("deviations", [0.0, 1e-12])
def test_a_core_that_differs_by_less_is_taken(tmp_path: Path, deviations: float) -> None:
    """So the refusals below are of the change, not of the copy."""
    path = model_with_core(tmp_path, "mine", shifted(0, deviations))
    chosen = load(str(path), AUTO)
    assert (chosen.runtime, chosen.why) == (COMPILED, "")
    assert find_core(path, chosen.model.sha256).difference() <= MOST_DIFFERENCE


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        (shifted(0, 1e-8), 1e-8),
        (shifted(1, -1e-8), 1e-8),
        (shifted(2, 1e-8), 1e-8),
        (widened, 1e-8),
        (set_to(40, 0, math.inf), math.inf),
        (set_to(40, 4, -math.inf), math.inf),
        (set_to(40, 1, math.nan), math.inf),
        (set_to(40, 2, math.nan), math.inf),
        (set_to(40, 3, 0.0), math.inf),
    ],
    ids=["c", "tan_phi", "velocity", "wider", "inf", "-inf", "nan", "nan_deviation", "deviation_0"],
)
def test_a_core_that_differs_is_refused_and_torchscript_runs_and_says_why(
    tmp_path: Path, change: Change, difference: float
) -> None:
    path = model_with_core(tmp_path, "mine", change)
    chosen = load(str(path), AUTO)
    assert chosen.runtime == chosen.model.runtime.name == TORCHSCRIPT
    said = re.fullmatch(
        rf"{path.with_suffix('.so')}: differs from TorchScript by (\S+) posterior deviations,"
        r" at most 1e-09 are allowed: build it anew",
        chosen.why,
    )
    assert said
    assert float(said[1]) == pytest.approx(difference, rel=0.2)
    with pytest.raises(ConfigError, match=r"^parameter runtime: compiled: .* differs from Torch"):
        load(str(path), COMPILED)


def test_the_torchscript_that_runs_instead_gives_the_bytes_of_the_one_asked_for(
    tmp_path: Path,
) -> None:
    path = model_with_core(tmp_path, "mine", shifted(0, 1e-8))
    one, other = (
        Estimator(load(str(path), wanted).model, CoreConfig()) for wanted in (AUTO, TORCHSCRIPT)
    )
    model = load_model(str(path))
    for observation in drive_observations(model.rover, model.metadata.soils[0], 2.0, seed=3):
        a, b = one.update(observation).estimate, other.update(observation).estimate
        assert a.mean.tobytes() == b.mean.tobytes()
        assert a.covariance.tobytes() == b.covariance.tobytes()


def test_a_sound_core_is_taken_though_another_one_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = model_with_core(tmp_path, "mine", shifted(0, 1e-8))
    with pytest.raises(CoreError, match="differs from TorchScript"):
        find_core(path, load_model(str(path)).sha256)
    installed = tmp_path / "prefix/lib/terrain_core"
    installed.mkdir(parents=True)
    altered(BUILT / "mars_rover.so", installed / "mine.so", lambda _: None)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    assert load(str(path), COMPILED).runtime == COMPILED
