# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""find_missing_effect on sealed bags of short drives, not how often its verdicts are right."""

import json
import re
import shutil
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest

from terrain_estimator.cli import find_missing_effect
from terrain_estimator.cli.find_missing_effect import main
from terrain_estimator.learning.finding_model import installed_model, write_model
from terrain_estimator.model.model_file import load_model
from terrain_estimator.model.row_names import row_names
from terrain_estimator.offline.reference_drives import reference_drives
from terramechanics.presets import load_rover
from tests.hidden.cases import Plan, draw_cases
from tests.hidden.sealing import seal


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    case = draw_cases(Plan((("drive_drag", 1.0),), soil="loose_sand", seconds=20.0), 1, seed=5)[0]
    return [str(bag) for bag in seal(case, tmp_path_factory.mktemp("sealed"))]


def test_a_drag_of_the_drives_is_named_with_its_size_and_written_to_a_file(
    bags: list[str], tmp_path: Path
) -> None:
    assert (
        main([*bags[:4], "--library", "drive_drag,slope_bias,sinkage_bias", "--out", str(tmp_path)])
        == 0
    )
    finding = json.loads((tmp_path / "finding.json").read_text(encoding="utf-8"))
    assert finding["verdict"] == "named"
    model = load_model(str(tmp_path / "model.pt"))
    assert [each.name for each in model.effects] == ["drive_drag"]
    assert list(reference_drives(tmp_path / "model.pt", model.metadata))
    assert (tmp_path / "model.drive.npz").is_file()
    effect = finding["effects"][0]
    assert effect["name"] == "drive_drag"
    assert effect["unit"] == "N m s/rad"
    assert 0.1 < effect["coefficient"] < 0.4
    assert 0.0 < effect["sd"] < 0.1
    assert abs(sum(finding["probabilities"].values()) - 1.0) < 1e-9
    assert set(finding["probabilities"]) == {
        "none",
        "unknown",
        "drive_drag",
        "slope_bias",
        "sinkage_bias",
    }
    assert {entry["row"] for entry in finding["where"]} <= set(row_names(3))
    assert {"row", "signal", "region", "strength", "unit", "p", "runs", "sentence"} == set(
        finding["where"][0]
    )
    assert any(
        entry["row"].startswith("torque") and entry["p"] < 0.01 for entry in finding["where"]
    )
    assert "sideways" in finding["isolability"]["not_testable"]["lateral_bulldozing"]
    assert len(finding["isolability"]["nats"]) == len(finding["isolability"]["names"])
    assert len(finding["runs"]) == 3
    assert len(finding["held_out"]) == 1
    assert not set(finding["runs"]) & set(finding["held_out"])
    assert finding["asked"] == {
        "rover": "mars_rover",
        "soil": "loose_sand",
        "other_soils": ["compact_sand", "loose_sand", "regolith"],
        "seed": 0,
        "topics": {},
        "parameters": {},
    }
    assert {name for name, _ in finding["provenance"]["runs_sha256"]} == {
        *finding["runs"],
        *finding["held_out"],
    }
    report = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<h1>The model lacks drive_drag</h1>" in report
    assert repr(effect["coefficient"]) in report


def test_on_a_wrong_soil_the_file_of_the_right_one_is_found_and_its_model_extended(
    bags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--library", "drive_drag,slope_bias", "--soil", "regolith", "--out", str(tmp_path)]
    assert main([*bags[:4], *options]) == 0
    finding = json.loads((tmp_path / "finding.json").read_text(encoding="utf-8"))
    assert [each["name"] for each in finding["effects"]] == ["drive_drag"]
    (soil,) = finding["soils"]
    assert (soil["soil"], soil["fits"], soil["file"]) == ("regolith", "loose_sand", None)
    assert finding["soil_proof"]["holds"]
    assert not (tmp_path / "soils").exists()
    assert [each.name for each in load_model(str(tmp_path / "model.pt")).effects] == ["drive_drag"]
    said = capsys.readouterr().out
    assert "soil regolith (3 runs): the file of loose_sand fits better" in said
    assert "the revised soils hold on held-out runs" in said
    report = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "the file of loose_sand fits better" in report


def test_what_the_runs_say_of_constants_of_the_rover_stands_beside_the_verdict(
    bags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stated = ["--rover-sd", "mass=2,wheel_radius=0.0005", "--library", "drive_drag,payload"]
    assert main([*bags[:4], *stated, "--out", str(tmp_path)]) == 0
    finding = json.loads((tmp_path / "finding.json").read_text(encoding="utf-8"))
    assert [each["name"] for each in finding["effects"]] == ["drive_drag"]
    assert finding["asked"]["rover_sd"] == {"mass": 2.0, "wheel_radius": 0.0005}
    mass, radius = finding["rover_constants"]
    assert (mass["name"], mass["told"], mass["told_sd"], mass["unit"]) == ("mass", 185.0, 2.0, "kg")
    assert mass["found"] == pytest.approx(185.0 + 2.0 * mass["moved"])
    assert 0.0 < mass["moved_sd"] <= 1.01
    assert abs(mass["moved"]) < 2.5
    assert (radius["name"], radius["effect"], radius["named"]) == (
        "wheel_radius",
        "odometry_scale",
        False,
    )
    assert re.search(r"rover: mass 18\d\.?\d* \+- .* kg, told 185 \+- 2", capsys.readouterr().out)
    report = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert '<h2 id="rover">The rover</h2>' in report


@pytest.mark.parametrize(
    ("library", "closest"), [("payload,drive_drag", "payload"), ("slope_bias", "slope_bias")]
)
def test_a_mass_that_files_are_usually_off_by_is_found_unless_the_file_is_said_to_be_exact(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], library: str, closest: str
) -> None:
    case = draw_cases(Plan(soil="loose_sand", seconds=20.0), 1, seed=5)[0]
    bags = [str(bag) for bag in seal(case, tmp_path / "sealed")]
    told = tmp_path / "lighter.yaml"
    text = files("terramechanics").joinpath("presets/rovers/mars_rover.yaml").read_text("utf-8")
    told.write_text(text.replace("mass: 185", "mass: 181"), encoding="utf-8")
    asked = [*bags[:4], "--rover", str(told), "--library", library, "--out"]
    assert main([*asked, str(tmp_path / "exact"), "--rover-sd", "exact"]) == 0
    assert f"closest: {closest}" in capsys.readouterr().out.splitlines()[0]
    assert main([*asked, str(tmp_path / "usual")]) == 0
    said = capsys.readouterr().out
    finding = json.loads((tmp_path / "usual/finding.json").read_text(encoding="utf-8"))
    assert finding["verdict"] == "none"
    assert finding["rover_tolerance"]["named"] == [closest]
    assert finding["rover_tolerance"]["rover_sd"]["mass"] == pytest.approx(1.81)
    assert "rover_sd" not in finding["asked"]
    taken = (
        f"with an exact rover file the answer is unknown (closest: {closest}); files are usually"
        " off by as much, so this answer takes --rover-sd mass=1.8"
    )
    assert taken in said
    assert taken[1:] in (tmp_path / "usual/report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        (["--rover-sd", "mas=2"], "--rover-sd: 'mas' has no deviation here: did you mean mass?"),
        (["--rover-sd", "mass=-2"], "--rover-sd: mass=-2 is no deviation: give a number from 0 on"),
        (["--rover-sd", "wheel_radius=2"], "--rover-sd: wheel_radius=2: constants that are off by"),
        (["--library", "gravity_waves"], "unknown effect 'gravity_waves'"),
        (["--library", "lateral_bulldozing"], "not testable here"),
        (["--soil", "cheese"], "cheese"),
        (["--other-soils", "cheese"], "cheese"),
        (["--soil", "sunday=regolith"], "--soil sunday=regolith: 'sunday' is no run of this call"),
        (["--model", "nowhere.pt"], "nowhere.pt"),
        (
            ["--model", "paper_rover"],
            (
                "model paper_rover was made for another rover than mars_rover: give its rover by"
                " --rover"
            ),
        ),
        (
            ["-p", "model:=paper_rover"],
            "model paper_rover was made for another rover than mars_rover",
        ),
        (
            ["-p", "pairing_tolerence:=0.1"],
            "unknown parameter pairing_tolerence: did you mean pairing_tolerance?",
        ),
        (["--remap", "odom:=/wheel_slip"], "/wheel_slip would be both"),
        (["--out", __file__], f"{__file__}: is a file, not a folder"),
    ],
)
def test_a_wrong_argument_is_refused_by_name(
    bags: list[str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    extra: list[str],
    said: str,
) -> None:
    # a search takes minutes: what is wrong is said before
    monkeypatch.setattr(find_missing_effect, "Study", None)
    assert main([*bags[:2], *extra]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    "extra",
    [
        ["--seed", "-1"],
        ["--seed", str(2**64)],
        ["--workers", "-2"],
        ["--workers", "many"],
        ["--rover-sd", "mass"],
        ["--rover-sd", "mass=much"],
        ["--rover-sd", "mass=2,mass=3"],
    ],
)
def test_numbers_that_no_generator_and_no_cluster_take_are_refused_by_name(
    capsys: pytest.CaptureFixture[str], extra: list[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["first", "second", *extra])
    assert ended.value.code == 2
    said = re.escape(extra[1].split(",")[0])
    assert re.search(
        f"argument {extra[0]}: '?({said}|mass is given twice)", capsys.readouterr().err
    )


def test_one_run_and_unreadable_runs_are_refused(
    bags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(bags[:1]) == 2
    assert "at least 2 are needed" in capsys.readouterr().err
    assert main([bags[0], str(tmp_path / "nothing_here")]) == 2
    complaint = capsys.readouterr().err
    assert "nothing_here is left out" in complaint
    assert "1 of 2 searched runs can be used, at least 2 are needed" in complaint


def test_a_run_that_is_given_twice_is_refused_under_whatever_name(
    bags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = tmp_path / "again"
    again.symlink_to(Path(bags[0]).resolve())
    for arguments in (
        [*bags[:2], "--hold-out", bags[0]],
        [*bags[:2], str(again)],
        [*bags[:2], "--hold-out", bags[2], bags[2]],
    ):
        assert main(arguments) == 2
        assert f"{arguments[-1]} is given twice" in capsys.readouterr().err


def test_a_copy_of_a_run_is_refused_under_whatever_name(
    bags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """To search, or to prove: its measurements would count twice."""
    copy = tmp_path / "another_name"
    shutil.copytree(bags[0], copy)
    for arguments in ([*bags[:2], str(copy)], [*bags[:2], "--hold-out", str(copy)]):
        assert main([*arguments, "--out", str(tmp_path / "out")]) == 2
        complaint = capsys.readouterr().err
        assert f"runs {Path(bags[0]).name} and another_name have" in complaint
        assert "seconds in common: every measurement counts once" in complaint
    assert not (tmp_path / "out").exists()


def test_a_model_of_two_runs_is_said_to_be_unproven(
    bags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*bags[:2], "--library", "drive_drag", "--out", str(tmp_path)]) == 0
    assert f"{tmp_path / 'model.pt'} (unproven: no run was held out)" in capsys.readouterr().out
    assert (tmp_path / "model.pt").is_file()


def test_a_rover_that_differs_in_names_alone_has_the_installed_model(
    bags: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mars, mine = load_rover("mars_rover"), tmp_path / "mine.yaml"
    text = (files("terramechanics.presets") / "rovers/mars_rover.yaml").read_text(encoding="utf-8")
    mine.write_text(text.replace("name: mars_rover", "name: my_rover"), encoding="utf-8")
    assert installed_model(mars) == "mars_rover"
    assert installed_model(replace(mars, mass=mars.mass + 1.0)) == ""
    out = tmp_path / "out"
    arguments = [*bags[:2], "--library", "drive_drag", "--rover", str(mine), "--out", str(out)]
    assert main(arguments) == 0
    said = capsys.readouterr()
    assert (
        "the model mars_rover is used: its rover differs from my_rover in names alone" in said.err
    )
    assert f"{out / 'model.pt'} (unproven" in said.out
    assert load_model(str(out / "model.pt")).rover == load_rover(str(mine))


def test_the_model_that_is_to_be_extended_is_never_removed(tmp_path: Path) -> None:
    path = tmp_path / "model.pt"
    path.write_bytes(b"a model")
    new, rover = tmp_path / "new.pt", load_rover("mars_rover")
    said = write_model(None, rover, str(path), path, new)  # type: ignore[arg-type]
    assert "give another --out" in str(said)
    assert not new.exists()
    assert "model.pt" not in find_missing_effect._results(str(path), tmp_path)
    assert "model.pt" in find_missing_effect._results("mars_rover", tmp_path)
