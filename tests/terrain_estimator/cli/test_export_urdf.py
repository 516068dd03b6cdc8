# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""The command that writes a URDF: to standard output, to a file, or not at all."""

from pathlib import Path

import pytest

from terrain_estimator.cli.export_urdf import main
from terramechanics.description.urdf import to_urdf
from terramechanics.presets import load_rover


def test_it_writes_to_standard_output_or_to_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["mars_rover"]) == 0
    assert capsys.readouterr().out == to_urdf(load_rover("mars_rover"))
    path = tmp_path / "rover.urdf"
    options = ["--track-width", "0.6", "--body-frame", "chassis", "--out", str(path)]
    assert main(["four_wheel_rover", *options]) == 0
    expected = to_urdf(load_rover("four_wheel_rover"), track_width=0.6, body_frame="chassis")
    assert path.read_text(encoding="utf-8") == expected
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["lunar_rover"], "lunar_rover: neither one of the rovers that come with the package"),
        (["mars_rover", "--body-frame", "rocker_link"], "rocker_link would be the name of two"),
        (["mars_rover", "--out", "/nowhere/rover.urdf"], "/nowhere"),
    ],
)
def test_what_is_wrong_is_named(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    said = capsys.readouterr()
    assert said.err.startswith("export_urdf: ")
    assert words in said.err
    assert said.out == ""


def test_a_track_that_is_none_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["mars_rover", "--track-width", "-1"])
    assert "at least 0" in capsys.readouterr().err
