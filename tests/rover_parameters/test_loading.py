# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Rovers and soils from presets and YAML files: every mistake is named."""

import json
import math
from pathlib import Path

import pytest
import yaml

from rover_parameters.records import ConfigError
from terramechanics.presets import PRESETS, load_rover, load_soil, rover_names, soil_names
from terramechanics.terrain.soil import CONSTANTS
from terramechanics.vehicle.rover import Joint

MARS = (PRESETS / "rovers" / "mars_rover.yaml").read_text(encoding="utf-8")
LOOSE = (PRESETS / "soils" / "loose_sand.yaml").read_text(encoding="utf-8")


def written(folder: Path, text: str, **changes: object) -> Path:
    """Write a file with that content, some keys changed; None removes a key."""
    content = json.loads(json.dumps(yaml.safe_load(text) | changes))  # without aliases
    path = folder / "given.yaml"
    path.write_text(
        yaml.safe_dump({key: value for key, value in content.items() if value is not None}),
        encoding="utf-8",
    )
    return path


def test_the_presets_are_those_of_the_literature() -> None:
    assert soil_names() == ("compact_sand", "loose_sand", "regolith")
    assert rover_names() == ("four_wheel_rover", "mars_rover", "paper_rover")
    loose, compact = load_soil("loose_sand"), load_soil("compact_sand")
    assert loose.constants().tolist() == [1.1, 900.0, 1523400.0, 0.025, 0.18, 0.32]
    assert compact.constants().tolist() == [0.47, 900.0, 1523400.0, 0.038, 0.43, 0.32]
    assert [getattr(loose, name) for name in CONSTANTS] == loose.constants().tolist()
    paper, mars = load_rover("paper_rover"), load_rover("mars_rover")
    assert (paper.mass, paper.wheel_radius, paper.wheel_width, paper.gravity) == (
        10.0,
        0.4,
        0.1,
        9.81,
    )
    assert (mars.mass, mars.wheel_radius, mars.wheel_width, mars.gravity) == (
        185.0,
        0.13,
        0.16,
        3.72,
    )
    assert paper.wheels_per_axle == mars.wheels_per_axle == 2
    assert mars.wheel_names[0] == "front_left"
    assert mars.wheel_axle == (0, 0, 1, 1, 2, 2)


def test_every_preset_of_a_soil_and_a_rover_carries_its_own_name() -> None:
    assert [load_soil(name).name for name in soil_names()] == list(soil_names())
    assert [load_rover(name).name for name in rover_names()] == list(rover_names())


def test_a_file_of_the_users_is_read_by_its_path(tmp_path: Path) -> None:
    assert load_soil(written(tmp_path, LOOSE, name="mine", n=1)).n == 1.0
    assert isinstance(load_soil(written(tmp_path, LOOSE, n=1)).n, float)
    assert load_rover(written(tmp_path, MARS, mass=200)).weight == 200 * 3.72


def test_names_in_brackets_are_those_of_the_wheels(tmp_path: Path) -> None:
    four = load_rover("four_wheel_rover")
    renamed = load_rover("four_wheel_rover[fl, fr,rl,rr]")
    assert renamed.wheel_names == ("fl", "fr", "rl", "rr")
    assert renamed.first_difference(four) is None
    file = written(tmp_path, MARS)
    assert load_rover(f"{file}[a,b,c,d,e,f]").wheel_names == tuple("abcdef")
    for wrong in ("fl,fr,rl", "", "fl,fr,,rr"):
        with pytest.raises(ConfigError, match=r"names in the brackets, .* wheels front_left, "):
            load_rover(f"four_wheel_rover[{wrong}]")
    with pytest.raises(ConfigError, match="are not all different"):
        load_rover("four_wheel_rover[a,a,b,c]")
    odd = file.rename(tmp_path / "odd[a,b].yaml")
    assert load_rover(odd).name == "mars_rover"


def test_a_number_with_an_exponent_is_a_number(tmp_path: Path) -> None:
    path = tmp_path / "given.yaml"
    path.write_text(LOOSE.replace("1523400.0", "1.5e6"), encoding="utf-8")
    assert load_soil(path).k_phi == 1.5e6


def test_an_unknown_name_lists_what_there_is() -> None:
    with pytest.raises(
        ConfigError, match=r"mud: neither one of the soils .*compact_sand, loose_sand, regolith"
    ):
        load_soil("mud")
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: neither one of the rovers"):
        load_rover("nowhere.yaml")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"k_psi": 1.0}, r"given\.yaml: unknown key 'k_psi': did you mean k_phi"),
        ({"n": None}, r"given\.yaml: missing key 'n'"),
        ({"n": "1.1"}, r"given\.yaml: n: expected a number, got '1\.1' \(str\)"),
        ({"n": True}, r"n: expected a number, got True"),
        ({"k_phi": 0}, r"k_phi: 0 is outside its range: a finite number above 0"),
        ({"k_phi": float("nan")}, r"k_phi: nan is outside its range"),
        (
            {"cohesion": -1.0},
            r"cohesion: -1 is outside its range: a finite number at least 0 \[Pa\]",
        ),
        ({"n": 4.0}, r"n: 4 is outside its range: .* at most 3"),
        ({"name": 3}, r"name: expected a text"),
    ],
)
def test_a_wrong_soil_is_refused_by_name(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        load_soil(written(tmp_path, LOOSE, **changes))


WHEELS = yaml.safe_load(MARS)["wheels"]
SIDES = ("left", "right")
NO_BOGIE: dict[str, object] = {"bogie_pivot_x": None, "bogie_pivot_height": None}
BOGIE: dict[str, object] = {"axles": [0, 1], "x": 0.35, "height": 0.3}


def test_a_bogie_may_be_in_front(tmp_path: Path) -> None:
    rover = load_rover(written(tmp_path, MARS, **NO_BOGIE, joints=[BOGIE]))
    assert rover.suspension == (Joint((0, 1), 0.35, 0.3),)
    assert rover.content()["joints"] == (BOGIE | {"axles": (0, 1)},)
    assert "bogie_pivot_x" not in rover.content()
    different = rover.first_difference(load_rover("mars_rover"))
    assert different is not None
    assert different[0] == "joints"


def test_the_short_form_of_a_bogie_and_its_long_one_are_the_same_rover(tmp_path: Path) -> None:
    behind = {"axles": [1, 2], "x": -0.35, "height": 0.3}
    rover = load_rover(written(tmp_path, MARS, **NO_BOGIE, joints=[behind]))
    mars = load_rover("mars_rover")
    assert rover.suspension == mars.suspension
    assert rover.first_difference(mars) is None
    assert list(mars.content()) == list(yaml.safe_load(MARS))


def test_four_wheels_have_no_joint() -> None:
    rover = load_rover("four_wheel_rover")
    assert (rover.axles, rover.suspension, rover.wheels_per_axle) == (2, (), 2)
    assert "joints" not in rover.content()


def test_a_rigid_body_may_have_any_number_of_axles(tmp_path: Path) -> None:
    rigid = load_rover(written(tmp_path, MARS, **NO_BOGIE))
    assert (rigid.axles, rigid.suspension, rigid.is_determined) == (3, (), False)
    wheels = [*WHEELS, *({"name": f"w{k}", "axle": 3, "side": SIDES[k]} for k in (0, 1))]
    long = {"axle_x": [0.7, 0.0, -0.7, -1.4], "wheels": wheels}
    bogie = load_rover(written(tmp_path, MARS, **NO_BOGIE, **long, joints=[BOGIE]))
    assert (bogie.axles, bogie.is_determined) == (4, False)
    for rover in (rigid, bogie):
        with pytest.raises(
            ConfigError, match=r"mars_rover: axle_x has \d axles and joints \d: .* model by wheel"
        ):
            rover.check_planar()
    load_rover("mars_rover").check_planar()


def test_rockers_may_be_fixed_and_files_of_before_have_a_differential(tmp_path: Path) -> None:
    mars = load_rover("mars_rover")
    assert mars.differential
    assert "differential" not in mars.content()
    same = load_rover(written(tmp_path, MARS, differential=True))
    assert same.content() == mars.content()
    # files beside models recognise their rover by what they recorded
    assert sorted(mars.record()) == sorted({*mars.content(), "joints"})
    fixed = load_rover(written(tmp_path, MARS, differential=False))
    assert fixed.record() == mars.record() | {"differential": False}
    assert fixed.content() == mars.content() | {"differential": False}
    assert fixed.is_determined
    assert fixed.first_difference(mars) == ("differential", False, True)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wheel_radios": 0.1}, r"unknown key 'wheel_radios'"),
        ({"mass": -185.0}, r"mass: -185 is outside its range: a finite number above 0 \[kg\]"),
        ({"axle_x": [0.7, 0.0]}, r"bogie_pivot_x is the pivot .* axle_x has 2: leave it out"),
        ({"axle_x": [0.7, 0.0], "bogie_pivot_x": None}, r"bogie_pivot_height are one joint"),
        ({"axle_x": [0.7, 0.0], **NO_BOGIE}, r"wheel \w+: axle 2: axle_x has axles 0 to 1"),
        ({"axle_x": [0.7], **NO_BOGIE}, r"axle_x has 1 axle and joints 0: the body needs 2 axles"),
        (
            {"axle_x": [0.7, 0.0], **NO_BOGIE, "joints": [BOGIE], "wheels": WHEELS[:4]},
            r"axle_x has 2 axles and joints 1: the body needs 2 axles, .* a joint, or it .* folds",
        ),
        (
            {"axle_x": [0.9, 0.7, 0.0, -0.7], **NO_BOGIE},
            r"wheels: every one of the 4 axles needs the same number of wheels, got \[2, 2, 2, 0\]",
        ),
        (
            {**NO_BOGIE, "differential": False},
            r"differential false: without a joint there are no rockers .*: leave it out",
        ),
        ({"differential": "no"}, r"differential: expected true or false, got 'no'"),
        (
            {**NO_BOGIE, "joints": [BOGIE | {"axles": axles} for axles in ([0, 1], [2, 3])]},
            r"joints: 2 are given, at most 1 is supported: an observation holds the angle of one",
        ),
        ({"joints": [BOGIE]}, r"bogie_pivot_height are one joint together: give both, or joints"),
        (
            {**NO_BOGIE, "joints": [BOGIE | {"axles": [0, 2]}]},
            r"joints\[0\]: axles \[0, 2\] are not",
        ),
        (
            {**NO_BOGIE, "joints": [BOGIE | {"axles": [2, 3]}]},
            r"joints\[0\]: axles \[2, 3\] are not",
        ),
        ({**NO_BOGIE, "joints": [BOGIE | {"axles": [1]}]}, r"joints\[0\]: axles: .* list of 2"),
        ({**NO_BOGIE, "joints": [BOGIE | {"x": -0.1}]}, r"joints\[0\]: x -0\.1 m must lie between"),
        ({**NO_BOGIE, "joints": [BOGIE | {"spring": 1.0}]}, r"joints\[0\]: unknown key 'spring'"),
        ({**NO_BOGIE, "joints": [BOGIE | {"height": -1}]}, r"joints\[0\]: height: -1 is outside"),
        ({"axle_x": [0.7, 0.0, "x"]}, r"axle_x\[2\]: expected a number, got 'x'"),
        ({"axle_x": 0.7}, r"axle_x: expected a list, got 0\.7"),
        ({"axle_x": [-0.7, 0.0, 0.7]}, r"axle_x .* must fall from front to rear"),
        (
            {"wheel_radius": 130.0},
            r"wheel_radius: 130 m is more than the 1\.4 m from the first axle .*is the unit m\?",
        ),
        (
            {"bogie_pivot_x": 0.2},
            r"bogie_pivot_x 0\.2 m must lie between its axles, -0\.7 and 0 m",
        ),
        ({"centre_of_mass_x": 0.9}, r"centre_of_mass_x 0\.9 m: .* between .* -0\.35 and 0\.7 m"),
        ({"centre_of_mass_x": math.nan}, r"centre_of_mass_x: nan .*: a finite number \[m\]"),
        ({"axle_x": [0.7, 0.0, -1e-9]}, r"axles 1 and 2 are at 0 and -1e-09 m: they must be 0\.01"),
        ({"axle_x": [700.0, 0.0, -0.7]}, r"axles 0 and 1 are at 700 and 0 m: .* within 100 m"),
        ({"cruise_speed": [0.3, 0.1]}, r"cruise_speed .* must not fall"),
        ({"wheels": []}, r"wheels: expected a list of at least 1 values"),
        ({"wheels": [*WHEELS[:5], WHEELS[0]]}, r"wheels: the names .* are not all different"),
        (
            {"wheels": WHEELS[:5]},
            r"wheels: every one of the 3 axles needs the same number of wheels, got \[2, 2, 1\]",
        ),
        (
            {"wheels": [*WHEELS[:5], {"name": "x", "axle": 3}]},
            r"wheel x: axle 3: axle_x has axles 0 to 2",
        ),
        (
            {"wheels": [*WHEELS[:5], {"name": "x", "axle": 2, "sight": "left"}]},
            r"wheels\[5\]: unknown key 'sight'",
        ),
        (
            {"wheels": [*WHEELS[:5], {"name": "x", "axle": 2, "side": "up"}]},
            r"wheels\[5\]: wheel x: side 'up'",
        ),
        (
            {"wheels": [*WHEELS[:5], {"name": "x", "axle": 2.0}]},
            r"wheels\[5\]: axle: expected a whole number",
        ),
        ({"wheels": [*WHEELS[:5], "rear"]}, r"wheels\[5\]: expected a mapping"),
    ],
)
def test_a_wrong_rover_is_refused_by_name(
    tmp_path: Path, changes: dict[str, object], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        load_rover(written(tmp_path, MARS, **changes))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LOOSE + "n: 1.0\n", r"not valid YAML: key 'n' is given twice"),
        ("n: [1", r"given\.yaml: not valid YAML"),
        ("n: 1.0\nname: %", r"put the text in quotes \(line 2, column 7\)"),
        ("", r"given\.yaml: expected a mapping of keys to values, got None"),
        ("- 1\n", r"expected a mapping"),
    ],
)
def test_a_file_that_is_no_mapping_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "given.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=message):
        load_soil(path)


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "given.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not valid YAML"):
        load_soil(path)


@pytest.mark.parametrize("key", ["mass", "gravity", "wheel_radius", "wheel_width"])
def test_a_small_rover_on_a_small_body_is_a_rover_and_one_of_nothing_is_not(
    key: str, tmp_path: Path
) -> None:
    """Every positive value counts: gravity on a small moon is below 1 m/s^2."""
    small = 0.9 if key == "gravity" else 1e-3
    assert getattr(load_rover(str(written(tmp_path, MARS, **{key: small}))), key) == small
    with pytest.raises(ConfigError, match=f"{key}: 0 is outside its range: .* above 0"):
        load_rover(str(written(tmp_path, MARS, **{key: 0.0})))
