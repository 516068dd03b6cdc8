# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Call a service once: `ros2 service call` for machines without a ROS 2 installation.

ros2_ws/bin/ros2 starts it.
"""

import argparse
import importlib
import os
import sys
from typing import Any, Protocol

import rclpy
from rclpy.node import Node

from rover_parameters.records import ConfigError
from rover_parameters.yaml_files import parse_yaml

APPEAR_S = 10.0
"""Discovery takes a second, and longer on a busy machine."""
ANSWER_S = 120.0
"""A recorder waits for its disk at "clean up", and compresses its bag."""


class CallError(Exception):
    """An error in the command, or of the service."""


class Message(Protocol):
    """Message of one of rclpy's classes."""

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Return the type of each field by its name, as rosidl_generator_py does."""


def main() -> int:
    """Call a service and print its answer; return 0, 1 without an answer, 2 for a wrong command."""
    parser = argparse.ArgumentParser(prog="ros2 service call", description="Calls a service once.")
    parser.add_argument("name", help="of the service, such as /planner/resume")
    parser.add_argument("type", help="such as std_srvs/srv/Trigger")
    parser.add_argument(
        "values",
        nargs="?",
        default="{}",
        help="of the request, in YAML; what is left out keeps its default",
    )
    options = parser.parse_args()
    os.environ["ROS_PYTHON_CHECK_FIELDS"] = (
        "1"  # messages look at it when they are imported: it makes a wrong type an AssertionError
    )
    try:
        kind = service_class(options.type)
        request = filled(kind.Request(), parse_yaml(options.values), "the request")
    except (CallError, ConfigError) as error:
        return refuse(2, error)
    rclpy.init()
    try:
        sys.stdout.write(f"requester: making request: {request}\n\n")
        sys.stdout.write(
            f"response:\n{answer(rclpy.create_node('operator'), options.name, kind, request)}\n\n"
        )
    except CallError as error:
        return refuse(1, error)
    except KeyboardInterrupt:
        return refuse(1, "interrupted")
    finally:
        rclpy.try_shutdown()
    return 0


def refuse(code: int, error: object) -> int:
    """Print an error; return the exit code."""
    sys.stderr.write(f"ros2 service call: {error}\n")
    return code


def service_class(name: str) -> type[Any]:
    """Return the class of a type such as ``std_srvs/srv/Trigger``. Raises CallError."""
    package, _, rest = name.partition("/")
    try:
        kind: type[Any] = getattr(
            importlib.import_module(f"{package}.srv"), rest.removeprefix("srv/")
        )
    except (ImportError, AttributeError, TypeError) as error:
        raise CallError(f"no type {name} is installed: {error}") from error
    return kind


def filled(message: Message, values: object, where: str) -> Message:
    """Return the message with these fields set. Raises CallError for a wrong name or type."""
    if not isinstance(values, dict):
        raise CallError(
            f"{where}: {values!r} is no mapping of fields to values, such as {{transition: {{id:"
            " 3}}"
        )
    fields = message.get_fields_and_field_types()
    for name, value in values.items():
        if name not in fields:
            raise CallError(f"{where} has no field {name}, but {', '.join(fields) or 'none'}")
        field = getattr(message, name)
        try:
            setattr(
                message,
                name,
                (
                    filled(field, value, name)
                    if hasattr(field, "get_fields_and_field_types")
                    else value
                ),
            )
        except AssertionError as error:
            raise CallError(f"{where}, field {name}: {error}") from error
    return message


def answer(node: Node, name: str, kind: type[Any], request: Message) -> object:
    """Return the answer of the service. Raises CallError where it is missing or does not answer."""
    client = node.create_client(kind, name)
    if not client.wait_for_service(timeout_sec=APPEAR_S):
        listed = node.get_service_names_and_types()
        type_name = f"{kind.__module__.partition('.')[0]}/srv/{kind.__name__}"
        others = [
            other for other, types in listed if type_name in types and other != client.srv_name
        ]
        raise CallError(
            f"no {client.srv_name} within {APPEAR_S:g} s in ROS_DOMAIN_ID"
            f" {os.environ.get('ROS_DOMAIN_ID', '0')}; of this type there are:"
            f" {', '.join(others) or 'none'}"
        )
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=ANSWER_S)
    if not future.done():
        raise CallError(f"{client.srv_name} has not answered within {ANSWER_S:g} s")
    return future.result()


if __name__ == "__main__":
    sys.exit(main())
