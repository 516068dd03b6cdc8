# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The command that adds an effect to a model by hand."""

from pathlib import Path

import pytest

from terrain_estimator.cli.add_effect import main, sized
from terrain_estimator.learning.adding import Sized
from terrain_estimator.model.model_file import load_model


def test_a_model_file_with_the_effects_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "model.pt"
    assert (
        main(["--effect", "slope_bias=0.02+-0.01", "--effect", "bulldozing", "--out", str(path)])
        == 0
    )
    assert f"{path}: mars_rover-" in capsys.readouterr().out
    before = {each.name: each.read_bytes() for each in tmp_path.iterdir()}
    assert main(["--effect", "payload", "--out", str(path)]) == 2
    assert f"{path} exists already" in capsys.readouterr().err
    assert {each.name: each.read_bytes() for each in tmp_path.iterdir()} == before
    found = [(each.name, each.unit, each.mean, each.sd) for each in load_model(str(path)).effects]
    assert found == [("slope_bias", "rad", 0.02, 0.01), ("bulldozing", "N/m^2", 0.0, 1e5)]


def test_signs_and_powers_of_ten_are_read() -> None:
    assert sized("payload=-2.5e+1+-.5") == Sized("payload", -25.0, 0.5)


def test_a_size_is_read_as_find_missing_effect_prints_it() -> None:
    assert sized("payload=-25 +- 0.5") == Sized("payload", -25.0, 0.5)


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        ("slope_bias=0.02", "expected NAME or NAME"),
        ("latency", "subtract the latency from the stamps"),
        ("x=1+-1", "unknown effect 'x'"),
    ],
)
def test_a_wrong_effect_is_refused_with_what_to_do(
    effect: str, said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["--effect", effect, "--out", str(tmp_path / "model.pt")]) == 2
    assert said in capsys.readouterr().err


def test_a_folder_that_is_none_is_refused_by_the_option(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--effect", "payload", "--out", f"{__file__}/model.pt"]) == 2
    assert f"{__file__}/model.pt: cannot be written (Not a directory)" in capsys.readouterr().err
