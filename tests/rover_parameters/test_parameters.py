# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""An unknown parameter, a wrong type or a value out of range is an error that names it."""

from pathlib import Path
from typing import Any

import pytest

from docs.pages import NODES
from rover_parameters.files import parse_assignment, read_parameters
from rover_parameters.parameters import configure, effective, flatten, parameters, template, usage
from rover_parameters.records import ConfigError
from rover_sim_node.config import SimulatorConfig
from terrain_estimator.config.estimator import EstimatorConfig


@pytest.mark.parametrize("config", NODES.values(), ids=NODES)
def test_every_parameter_is_described_and_its_default_may_be_given(config: type[Any]) -> None:
    assert str(configure(config, {})) == str(config())  # as texts: NaN is not equal to itself
    assert str(effective(config())) == str(
        {entry.name: entry.default for entry in parameters(config)}
    )
    assert all(entry.description for entry in parameters(config))
    assert str(configure(config, effective(config()))) == str(config())


@pytest.mark.parametrize("config", NODES.values(), ids=NODES)
def test_help_lists_every_parameter(config: type[Any]) -> None:
    text = usage("program", "a:=b", config)
    assert all(f"  {entry.name} (default " in text for entry in parameters(config))


def test_nested_and_flat_names_mean_the_same() -> None:
    nested = configure(EstimatorConfig, {"prior": {"cohesion_mean": 1200.0, "cohesion_sd": 300.0}})
    assert nested == configure(
        EstimatorConfig, {"prior.cohesion_mean": 1200.0, "prior.cohesion_sd": 300.0}
    )
    assert nested.core.prior_cohesion_mean_pa == 1200.0


def test_an_int_is_taken_where_a_float_is_meant() -> None:
    built = configure(EstimatorConfig, {"pairing_timeout": 1})
    assert built.pairing.timeout_s == 1.0
    assert isinstance(built.pairing.timeout_s, float)


@pytest.mark.parametrize(
    ("config", "values", "words"),
    [
        (EstimatorConfig, {"modell": "x"}, ["modell", "did you mean model?"]),
        (
            EstimatorConfig,
            {"prior": {"cohesion_men": 1.0}},
            ["prior.cohesion_men", "did you mean prior.cohesion_mean?"],
        ),
        (EstimatorConfig, {"prior": 3}, ["parameter prior"]),
        (EstimatorConfig, {"zzz": 1}, ["zzz", "known are", "use_imu"]),
        (EstimatorConfig, {"use_imu": 1}, ["use_imu", "true or false"]),
        (EstimatorConfig, {"pairing_timeout": "long"}, ["pairing_timeout", "'long'", "a number"]),
        (
            EstimatorConfig,
            {"pairing_timeout": -1.0},
            ["pairing_timeout", "-1", "at least 0 and at most 60 [s]"],
        ),
        (EstimatorConfig, {"pairing_timeout": float("nan")}, ["pairing_timeout", "nan"]),
        (
            EstimatorConfig,
            {"prior.cohesion_mean": 1000.0},
            ["prior.cohesion_mean", "prior.cohesion_sd"],
        ),
        (
            EstimatorConfig,
            {"prior.tan_phi_sd": 0.1},
            ["prior.tan_phi_sd: 0.1", "prior.tan_phi_mean", "both or none"],
        ),
        (SimulatorConfig, {"sed": 1}, ["unknown parameter sed", "did you mean seed?"]),
        (
            SimulatorConfig,
            {"soil_overrides.cohesio": 1.0},
            ["soil_overrides.cohesio", "did you mean soil_overrides.cohesion?"],
        ),
        (
            SimulatorConfig,
            {"soil_overrides": {"cohesion": -1.0}},
            ["soil_overrides.cohesion: -1 is outside its range"],
        ),
        (
            SimulatorConfig,
            {"soil_overrides.n": float("inf")},
            ["soil_overrides.n: inf is outside its range"],
        ),
        (
            SimulatorConfig,
            {"rate": 0.0},
            ["rate: 0 is outside its range", "at least 1 and at most 50 [Hz]"],
        ),
        (SimulatorConfig, {"seed": 1.5}, ["seed: expected a whole number"]),
        (SimulatorConfig, {"soil": 3}, ["soil: expected a text"]),
        (SimulatorConfig, {"soil.name": "x", "soil": "y"}, ["unknown parameter soil.name"]),
    ],
)
def test_what_is_wrong_is_named_with_what_to_do(
    config: type[Any], values: dict[str, Any], words: list[str]
) -> None:
    with pytest.raises(ConfigError) as error:
        configure(config, values)
    assert all(word in str(error.value) for word in words), error.value


def test_the_fingerprint_depends_on_values_and_not_on_paths() -> None:
    plain = EstimatorConfig()
    assert (
        plain.sha256()
        == configure(EstimatorConfig, {"model": "elsewhere.pt", "rover": "mars_rover"}).sha256()
    )
    assert plain.sha256() != configure(EstimatorConfig, {"use_imu": False}).sha256()
    assert plain.sha256("ab") != plain.sha256()


@pytest.mark.parametrize(("node", "config"), NODES.items(), ids=NODES)
def test_a_dumped_configuration_read_again_is_the_same(
    node: str, config: type[Any], tmp_path: Path
) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(template(f"/{node}", config()))
    assert str(configure(config, read_parameters(path, f"/{node}"))) == str(config())


SECTIONS = [
    ("estimator", "/estimator", True),
    ("/estimator", "/estimator", True),
    ("estimator", "/rover1/estimator", False),  # as ROS takes it: without a namespace
    ("/rover1/estimator", "/rover1/estimator", True),
    ("/**", "/rover1/estimator", True),
    ("/*", "/estimator", True),
    ("/*/estimator", "/rover1/estimator", True),
    ("/*/estimator", "/a/b/estimator", False),
    ("/**/estimator", "/a/b/estimator", True),
    ("/**/estimator", "/a/b/recorder", False),
    ("estimatr", "/estimator", False),
]


@pytest.mark.parametrize(("section", "node", "matches"), SECTIONS)
def test_a_section_is_for_the_nodes_whose_name_it_matches(
    tmp_path: Path, section: str, node: str, *, matches: bool
) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(f"{section}: {{ros__parameters: {{use_imu: false, use_sim_time: true}}}}\n")
    if matches:
        assert read_parameters(path, node) == {"use_imu": False}
        return
    with pytest.raises(ConfigError, match=f"no section is for the node {node} ") as error:
        read_parameters(path, node)
    assert f"its sections are /{section.strip('/')}" in str(error.value)


def test_only_what_ros_gives_every_node_is_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "estimator.yaml"
    path.write_text(
        "estimator: {ros__parameters: {use_sim_timee: true, use_sim_time: true, "
        "qos_overrides: {/imu: {subscription: {reliability: best_effort}}}}}\n"
    )
    assert read_parameters(path, "/estimator") == {"use_sim_timee": True}


def test_namespaces_may_be_nested_and_a_later_section_wins(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(
        "/**: {ros__parameters: {prior: {soil: regolith, tan_phi_sd: 0.2}}}\n"
        "rover1: {estimator: {ros__parameters: {prior: {tan_phi_sd: 1e-1}}}}\n"
    )
    assert read_parameters(path, "/rover1/estimator") == {
        "prior.soil": "regolith",
        "prior.tan_phi_sd": 0.1,
    }


@pytest.mark.parametrize(
    "content",
    [
        "",
        "simulator: {ros__parameters: {}}",
        "[1, 2]",
        "estimator: {use_imu: true}",
        "estimator: {",
        "\x00",
        "a: {ros_parameters: {b: 1}}",
    ],
)
def test_a_file_without_the_nodes_parameters_is_refused_by_name(
    tmp_path: Path, content: str
) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(content)
    with pytest.raises(ConfigError, match=r"p\.yaml"):
        read_parameters(path, "/estimator")


def test_a_missing_parameter_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.yaml"):
        read_parameters(tmp_path / "none.yaml", "/estimator")


def test_assignments_have_the_form_of_ros() -> None:
    assert parse_assignment("use_imu:=false") == ("use_imu", False)
    assert parse_assignment("gate_probability:=1e-4") == ("gate_probability", 1e-4)
    for text in ("use_imu=false", "use_imu:=[1"):
        with pytest.raises(ConfigError, match="use_imu"):
            parse_assignment(text)


def test_flat_names_are_joined_by_dots() -> None:
    assert flatten({"a": {"b": {"c": 1}}, "d": 2}) == {"a.b.c": 1, "d": 2}
