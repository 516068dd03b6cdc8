# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters are strict: what is unknown, of a wrong type or out of range is named, on every way in."""

from pathlib import Path
from typing import Any

import pytest

from terrain_estimator.cli.params_file import parse_assignment, read_parameters
from terrain_estimator.config import EstimatorConfig
from terrain_estimator.parameters import ParameterError, build, definitions, effective


def test_the_defaults_are_those_of_the_definition() -> None:
    assert build(EstimatorConfig, {}) == EstimatorConfig()
    assert effective(EstimatorConfig()) == {entry.name: entry.default for entry in definitions(EstimatorConfig)}


def test_every_parameter_is_described_and_its_default_is_allowed() -> None:
    for entry in definitions(EstimatorConfig):
        assert entry.description
        assert entry.check(entry.default) == entry.default


def test_nested_and_flat_names_mean_the_same() -> None:
    nested = build(EstimatorConfig, {"prior": {"cohesion_mean": 1200.0, "cohesion_sd": 300.0}})
    assert nested == build(EstimatorConfig, {"prior.cohesion_mean": 1200.0, "prior.cohesion_sd": 300.0})
    assert nested.core.prior_cohesion_mean_pa == 1200.0


def test_an_int_is_taken_where_a_float_is_meant() -> None:
    built = build(EstimatorConfig, {"pairing_timeout": 1})
    assert built.pairing.timeout_s == 1.0
    assert isinstance(built.pairing.timeout_s, float)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"modell": "x"}, ["modell", "did you mean model?"]),
        ({"prior": {"cohesion_men": 1.0}}, ["prior.cohesion_men", "prior.cohesion_mean"]),
        ({"zzz": 1}, ["zzz", "use_imu"]),
        ({"use_imu": 1}, ["use_imu", "bool"]),
        ({"pairing_timeout": "long"}, ["pairing_timeout", "'long'", "float"]),
        ({"pairing_timeout": -1.0}, ["pairing_timeout", "-1", "0 to 60 s"]),
        ({"pairing_timeout": float("nan")}, ["pairing_timeout", "nan"]),
        ({"prior.cohesion_mean": 1000.0}, ["prior.cohesion_mean", "prior.cohesion_sd"]),
    ],
)
def test_what_is_wrong_is_named_with_what_to_do(values: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ParameterError) as error:
        build(EstimatorConfig, values)
    assert all(word in str(error.value) for word in words)


def test_the_fingerprint_depends_on_values_and_not_on_paths() -> None:
    plain = EstimatorConfig()
    assert plain.sha256() == build(EstimatorConfig, {"model": "elsewhere.pt", "rover": "mars_rover"}).sha256()
    assert plain.sha256() != build(EstimatorConfig, {"use_imu": False}).sha256()


def test_a_parameter_file_is_read_as_the_node_would(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(
        "/**: {ros__parameters: {use_imu: false, use_sim_time: true}}\nestimator: {ros__parameters: {prior: {tan_phi_sd: 0.1}}}\n"
    )
    assert build(EstimatorConfig, read_parameters(path)).core.prior_tan_phi_sd == 0.1
    assert not build(EstimatorConfig, read_parameters(path)).core.use_imu


@pytest.mark.parametrize(
    "content", ["", "simulator: {ros__parameters: {}}", "[1, 2]", "estimator: {use_imu: true}", "estimator: {", "\x00"]
)
def test_a_file_without_the_estimators_parameters_is_refused_by_name(tmp_path: Path, content: str) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(content)
    with pytest.raises(ParameterError, match=r"p\.yaml"):
        read_parameters(path)


def test_a_missing_parameter_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match=r"none\.yaml"):
        read_parameters(tmp_path / "none.yaml")


def test_assignments_have_the_form_of_ros() -> None:
    assert parse_assignment("use_imu:=false") == ("use_imu", False)
    with pytest.raises(ParameterError, match="name:=value"):
        parse_assignment("use_imu=false")
