# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""A rover written as a URDF and read again is the same; what is wrong is refused by name."""

import dataclasses
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from terrain_estimator.cli.import_urdf import main
from terramechanics.description.urdf import to_urdf
from terramechanics.presets import load_rover
from terramechanics.vehicle.rover import Joint, Rover
from tests.rovers import (
    BOGIE_IN_FRONT,
    EIGHT_WHEELS,
    FIXED_ROCKERS,
    FOUR_WHEELS,
    MARS,
    SIX_WHEELS,
)

TRACK = 0.9
LIKE_HUSKY = """<robot name="husky">
  <link name="base_link"/>
  <link name="body"><inertial><mass value="46"/><origin xyz="-0.01 0 0.2"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="fixed" type="fixed"><parent link="base_link"/><child link="body"/></joint>
  {wheels}
</robot>"""
WHEEL = """<link name="{name}_link"><inertial><mass value="2.6"/>
    <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.035" iyz="0" izz="0.02"/></inertial>
    <collision><origin rpy="1.5708 0 0"/><geometry><cylinder radius="{radius}" length="0.1143"/>
    </geometry></collision></link>
  <joint name="{name}" type="continuous"><parent link="body"/><child link="{name}_link"/>
    <origin xyz="{x} {y} {z}"/><axis xyz="0 1 0"/></joint>"""
PLACES = {
    "fl": (0.256, 0.2854), "fr": (0.256, -0.2854), "rl": (-0.256, 0.2854), "rr": (-0.256, -0.2854),
}  # fmt: skip


def husky(**changed: tuple[float, float, float, float]) -> str:
    """Return a URDF like the Husky's; ``changed`` gives wheels x, y, z [m] and a radius [m]."""
    parts = []
    for name, (x, y) in PLACES.items():
        place = changed.get(name, (x, y, 0.03282, 0.1651))
        keys = dict(zip(("x", "y", "z", "radius"), place, strict=True))
        parts.append(WHEEL.format(name=name, **keys))
    return LIKE_HUSKY.format(wheels="\n".join(parts))


GIVEN = ("--mass", "100", "--centre-of-mass", "0", "0.3", "--wheel-inertia", "0.04")


def two_bogies() -> str:
    """Return a URDF of eight wheels on two bogies."""
    front = dataclasses.replace(EIGHT_WHEELS, joints=(Joint((0, 1), 0.4, 0.3),))
    text = to_urdf(front, track_width=TRACK)
    rear = """<joint name="rear" type="continuous"><parent link="rocker_link"/>
      <child link="rear_link"/><origin xyz="-0.4 0 0.05"/><axis xyz="0 -1 0"/></joint>
      <link name="rear_link"/></robot>"""
    robot = ET.fromstring(text.replace("</robot>", rear))
    for joint in robot.iter("joint"):
        if joint.attrib["name"].startswith(("third", "fourth")):
            joint.find("parent").set("link", "rear_link")  # type: ignore[union-attr]
            origin = joint.find("origin")
            assert origin is not None
            x, y, z = map(float, origin.attrib["xyz"].split())
            origin.set("xyz", f"{x + 0.4:g} {y:g} {z - 0.05:g}")
    return ET.tostring(robot, encoding="unicode")


def imported(folder: Path, text: str, *options: str) -> Rover:
    (folder / "robot.urdf").write_text(text, encoding="utf-8")
    out = folder / "rover.yaml"
    assert main([str(folder / "robot.urdf"), "--out", str(out), *options]) == 0
    return load_rover(out)


@pytest.mark.parametrize(
    "rover",
    [MARS, FOUR_WHEELS, BOGIE_IN_FRONT, SIX_WHEELS, EIGHT_WHEELS, FIXED_ROCKERS],
    ids=lambda rover: rover.name,
)
@pytest.mark.parametrize("steered", [False, True])
def test_what_was_written_is_read_again(
    rover: Rover, tmp_path: Path, capsys: pytest.CaptureFixture[str], *, steered: bool
) -> None:
    """All that a URDF of ours has; it has no masses, so they are given."""
    turned = rover.wheel_names if steered else ()
    text = to_urdf(rover, track_width=TRACK, steered=turned)
    centre = rover.centre_of_mass_x, rover.centre_of_mass_height
    found = imported(
        tmp_path, text, "--mass", str(rover.mass), "--centre-of-mass", *map(str, centre),
        "--wheel-inertia", str(rover.wheel_inertia), "--gravity", str(rover.gravity),
        "--cruise-speed", *map(str, rover.cruise_speed),
    )  # fmt: skip
    assert rover.first_difference(found) is None
    assert rover.other_side(found) is None
    assert sorted(found.wheel_names) == sorted(rover.wheel_names)
    said = capsys.readouterr().out
    assert f"--track-width {TRACK:g}" in said
    assert ("--steered" in said) == steered
    if steered:
        assert set(said.split("--steered ")[1].split()) == set(rover.wheel_names)


def test_masses_and_the_ground_come_from_the_links(tmp_path: Path) -> None:
    found = imported(tmp_path, husky())
    assert found.wheel_names == ("fl", "fr", "rl", "rr")
    assert found.mass == pytest.approx(46.0 + 4 * 2.6)
    assert found.wheel_inertia == pytest.approx(0.035)
    assert (found.wheel_radius, found.wheel_width) == (0.1651, 0.1143)
    ground = 0.03282 - 0.1651
    assert found.centre_of_mass_x == pytest.approx(-0.01 * 46.0 / 56.4)
    height = (46.0 * 0.2 + 4 * 2.6 * 0.03282) / 56.4 - ground
    assert found.centre_of_mass_height == pytest.approx(height)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("<robot", (), "no URDF that can be read"),
        (husky(), ("--body-frame", "chassis"), "link chassis is not in the URDF"),
        (husky(fl=(0.256, 0.2854, 0.03282, 0.2)), (), "the wheels differ in their radius"),
        (husky(fl=(0.256, 0.2854, 0.1, 0.1651)), (), "on one level"),
        (husky(fl=(0.256, 0.0, 0.03282, 0.1651)), (), "wheel fl is in the middle"),
        (
            husky(fl=(0.3, 0.2854, 0.03282, 0.1651)),
            (),
            "every one of the 3 axles needs the same number of wheels, got [1, 1, 2]",
        ),
        (two_bogies(), GIVEN, "joints: 2 are given, at most 1 is supported"),
        (husky().replace("continuous", "fixed"), (), "no wheel: a wheel is the child"),
        (to_urdf(load_rover("mars_rover")), (), "no masses: give --mass"),
        (to_urdf(load_rover("mars_rover")), ("--mass", "9"), "give --centre-of-mass"),
    ],
)
def test_what_is_wrong_is_named_and_nothing_is_written(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    text: str,
    options: tuple[str, ...],
    words: str,
) -> None:
    (tmp_path / "robot.urdf").write_text(text, encoding="utf-8")
    out = tmp_path / "rover.yaml"
    assert main([str(tmp_path / "robot.urdf"), "--out", str(out), *options]) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()


def test_a_file_that_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    imported(tmp_path, husky())
    before = (tmp_path / "rover.yaml").read_text(encoding="utf-8")
    assert main([str(tmp_path / "robot.urdf"), "--out", str(tmp_path / "rover.yaml")]) == 2
    assert "is there already" in capsys.readouterr().err
    assert (tmp_path / "rover.yaml").read_text(encoding="utf-8") == before
