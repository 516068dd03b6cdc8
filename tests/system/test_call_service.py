# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""`ros2 service call` without a ROS installation: requests of any type, and its errors."""

import runpy
from pathlib import Path
from typing import Any

import pytest
import yaml
from std_srvs.srv import Trigger

from tests.system.listening import Listener

SCRIPT = Path(__file__).parents[2] / "ros2_ws/call_service.py"


@pytest.fixture(scope="module")
def script() -> dict[str, Any]:
    return runpy.run_path(str(SCRIPT))


def test_values_go_to_the_fields_that_they_name(script: dict[str, Any]) -> None:
    kind = script["service_class"]("lifecycle_msgs/srv/ChangeState")
    request = script["filled"](
        kind.Request(), yaml.safe_load("{transition: {id: 3, label: activate}}"), "the request"
    )
    assert (request.transition.id, request.transition.label) == (3, "activate")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ("{transition: {ids: 3}}", "transition has no field ids, but id, label"),
        ("{transition: 3}", "transition: 3 is no mapping"),
        ("[3]", r"the request: \[3\] is no mapping"),
    ],
)
def test_wrong_values_are_refused_by_name(script: dict[str, Any], values: str, words: str) -> None:
    kind = script["service_class"]("lifecycle_msgs/srv/ChangeState")
    with pytest.raises(script["CallError"], match=words):
        script["filled"](kind.Request(), yaml.safe_load(values), "the request")


@pytest.mark.parametrize("name", ["std_srvs/srv/Trigge", "std_srv/srv/Trigger", "Trigger", ""])
def test_a_type_that_is_not_there_is_refused_by_name(script: dict[str, Any], name: str) -> None:
    with pytest.raises(script["CallError"], match=f"no type {name} is installed"):
        script["service_class"](name)


def test_a_service_that_is_not_there_is_refused_with_those_that_are(
    script: dict[str, Any], listener: Listener
) -> None:
    listener.node.create_service(Trigger, "/planner/resume", lambda _, response: response)
    script["answer"].__globals__["APPEAR_S"] = 0.05
    with pytest.raises(
        script["CallError"],
        match=r"no /planner/resum within .* of this type there are: /planner/resume$",
    ):
        script["answer"](listener.node, "/planner/resum", Trigger, Trigger.Request())
