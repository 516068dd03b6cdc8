# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Soil files of revised constants: their names, and what held-out runs say of them."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from terrain_estimator.cli.find_missing_effect import InputError, _divided, main
from terrain_estimator.cli.find_missing_effect import _refuse_soils_of_the_results as refuse_results
from terrain_estimator.discovery.evidence.soil_revision import RevisedStudy, Revision
from terrain_estimator.discovery.evidence.verdict import Judgement, Verdict
from terrain_estimator.discovery.proof.rule import LIKELIER
from terrain_estimator.discovery.proof.soil_proof import Proven, SoilProof
from terrain_estimator.discovery.report.finding import Finding
from terrain_estimator.learning.finding_model import _file_of, _has_soils
from terrain_estimator.offline.revised_soils import soils_content, write_soils
from terrain_estimator.offline.run_soils import RunSoils
from terrain_estimator.pages.finding_words import ground_words, soil_words, verdict
from terramechanics.presets import load_soil
from tests.terrain_estimator.pages.findings import finding as content_of

SAND = load_soil("loose_sand")


def outcome(*names: str, soil: SoilProof | None = None, proof: Any = None) -> Proven:
    """Return a finding with soils of these names, whose n was told too large."""
    revisions = tuple(
        Revision(
            replace(SAND, name=name, n=1.3), replace(SAND, name=f"{name}_found"), 2, {"n": 0.01}
        )
        for name in names
    )
    study: Any = None
    judgement = Judgement(Verdict.SOIL, (), {"soil": 1.0})
    nothing: Any = None
    finding = Finding(
        judgement, nothing, (), nothing, (), RevisedStudy(study, revisions, 0.0, nothing)
    )
    return Proven(finding, proof, soil)


@pytest.mark.parametrize(
    ("names", "files"),
    [
        (("sand", "dune"), ["sand_found", "dune_found"]),
        (("sand", "sand", "sand"), ["sand_found", "sand_found_2", "sand_found_3"]),
        (("site A/B",), ["site_A_B_found"]),
        (("../../evil",), ["evil_found"]),
        (("line\nbreak",), ["line_break_found"]),
    ],
)
def test_every_soil_has_a_file_of_its_own_in_the_folder(
    names: tuple[str, ...], files: list[str], tmp_path: Path
) -> None:
    places = [f"soils/{name}.yaml" for name in files]
    found = outcome(*names)
    assert write_soils(found, tmp_path) == places
    assert [each["file"] for each in soils_content(found)] == places
    assert sorted(each.relative_to(tmp_path) for each in tmp_path.rglob("*.yaml")) == sorted(
        map(Path, places)
    )
    for name, place in zip(files, places, strict=True):
        assert load_soil(str(tmp_path / place)) == replace(SAND, name=name)


def test_a_soil_that_fits_beside_a_revised_one_has_no_file(tmp_path: Path) -> None:
    both = outcome("sand", "dune")
    assert both.finding.soil is not None
    sand, dune = both.finding.soil.revisions
    study = replace(both.finding.soil, revisions=(sand, replace(dune, sd={"n": 0.2})))
    fits = Proven(replace(both.finding, soil=study))
    assert write_soils(fits, tmp_path) == ["soils/sand_found.yaml"]
    assert [each["file"] for each in soils_content(fits)] == ["soils/sand_found.yaml", None]
    assert [soil_words(each) for each in soils_content(fits)] == [
        "soil sand (2 runs): n 1.1 +- 0.01 instead of 1.3",
        "soil dune (2 runs): its file fits",
    ]


def test_a_soil_whose_runs_another_file_fits_has_no_new_file(tmp_path: Path) -> None:
    both = outcome("sand", "dune")
    assert both.finding.soil is not None
    files = tuple(
        replace(each, found=load_soil("regolith"), of_file=True)
        for each in both.finding.soil.revisions
    )
    found = Proven(replace(both.finding, soil=replace(both.finding.soil, revisions=files)))
    assert write_soils(found, tmp_path) == []
    content = soils_content(found)
    assert [(each["file"], each["fits"]) for each in content] == [(None, "regolith")] * 2
    assert soil_words(content[0]) == "soil sand (2 runs): the file of regolith fits better"
    told = {"soils": content, "probabilities": {"soil": 1.0}, "runs": ["1", "2", "3", "4"]}
    page = verdict(content_of("soil") | told)
    assert page.headline == "The ground is regolith"
    assert "the file of regolith fits better" in page.sentence
    assert ground_words(content, 4) == "the ground is regolith"
    assert ground_words(content, 6) == (
        "runs told to be on sand are on regolith and runs told to be on dune are on regolith"
    )
    assert ground_words(soils_content(both), 4) == ""
    assert _file_of(found.finding.soil) == "regolith"  # type: ignore[arg-type]
    assert _file_of(both.finding.soil) == "the soil file above"


@pytest.mark.parametrize(("change", "has"), [({"name": "mine"}, True), ({"n": 0.9}, False)])
def test_a_model_has_a_soil_whatever_its_name(change: dict[str, Any], *, has: bool) -> None:
    soil = replace(load_soil("regolith"), cohesion=600.0, **change)
    nothing: Any = None
    revision = Revision(SAND, soil, 2, {"n": 0.01}, of_file=True)
    study = RevisedStudy(nothing, (revision,), 0.0, nothing)
    assert _has_soils("mars_rover", study) is has


def test_constants_that_held_out_runs_refute_have_no_file(tmp_path: Path) -> None:
    refuted = outcome("sand", soil=SoilProof(2.0, 2.0, 1.0, 0.9 * LIKELIER), proof=object())
    assert write_soils(refuted, tmp_path) == []
    assert list(tmp_path.iterdir()) == []
    assert [each["file"] for each in soils_content(refuted)] == [None]
    assert "do not hold" in refuted.soil_sentence
    content = content_of("named") | {
        "soils": soils_content(refuted),
        "soil_proof": {"holds": False, "sentence": refuted.soil_sentence},
    }
    assert "did not hold on held-out runs" in verdict(content).sentence


def test_without_a_held_out_run_on_a_revised_soil_its_constants_are_unproven() -> None:
    assert outcome("sand", proof=object()).soil_sentence == (
        "no held-out run is on soil sand: the revised soil is unproven"
    )
    assert not outcome("sand", proof=object()).soil_refuted
    assert outcome("sand").soil_sentence == ""


def test_a_soil_file_among_the_results_is_refused_before_they_are_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    (place,) = write_soils(outcome("sand"), _made(out))
    file = out / place
    told = RunSoils({Path("a"): str(file)}, {Path("a"): SAND})
    with pytest.raises(InputError, match=r"^--soil .* a result of .*: give another --out, or copy"):
        refuse_results(told, out)
    other = RunSoils({Path("a"): "loose_sand"}, {Path("a"): SAND}, (str(file),))
    with pytest.raises(InputError, match=r"^--other-soils .*: it is a result of"):
        refuse_results(other, out)
    refuse_results(told, tmp_path / "other")
    runs = [str(tmp_path / name) for name in ("a", "b")]
    assert main([*runs, "--soil", str(file), "--out", str(out)]) == 2
    assert "it is a result of" in capsys.readouterr().err
    assert file.is_file()


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


@pytest.mark.parametrize("seed", range(20))
def test_every_soil_is_searched_where_that_leaves_runs_for_the_proof(seed: int) -> None:
    """Of three runs on sand and one on another soil, one on sand is held out."""
    runs = [Path(name) for name in "abcd"]
    soils = {run: SAND if run.name != "b" else replace(SAND, name="dune") for run in runs}
    options = argparse.Namespace(runs=runs, hold_out=[], seed=seed)
    searched, held_out = _divided(options, RunSoils(dict.fromkeys(runs, ""), soils))
    assert len(held_out) == 1
    assert Path("b") in searched
    assert sorted([*searched, *held_out]) == runs
