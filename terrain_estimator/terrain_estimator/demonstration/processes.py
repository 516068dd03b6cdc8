# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Run executables of installed packages, wait for their output, and leave no process behind."""

import ctypes
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

POLL_S = 0.02
_LIBC = ctypes.CDLL(None)
STOP_TIMEOUT_S = 15.0


class FleetError(RuntimeError):
    """A process ended early or timed out; the message ends with its last lines."""


def executable(package: str, name: str) -> str:
    """Return the path of a package's executable, as ``ros2 run`` finds it.

    Raises FleetError where the package is not installed.
    """
    try:
        return str(Path(get_package_prefix(package), "lib", package, name))
    except (PackageNotFoundError, OSError) as error:  # OSError: no workspace at all is sourced
        raise FleetError(
            f"package {package} is not installed; source the workspace first: . ros2_ws/setup.bash"
        ) from error


class Program:
    """One process whose output goes to a file."""

    def __init__(self, command: list[str], log: Path, environment: dict[str, str]) -> None:
        """Start it in a session of its own, so that Ctrl-C reaches it through this process only."""
        self.name = Path(command[0]).name
        self.log = log
        with log.open("wb") as stream:
            self._process = subprocess.Popen(  # noqa: S603
                command,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
                # one thread, and nothing but a system call
                preexec_fn=_end_with_parent,  # noqa: PLW1509
            )

    @property
    def running(self) -> bool:
        """Return whether it has not ended."""
        return self._process.poll() is None

    @property
    def output(self) -> str:
        """Return its output so far."""
        return self.log.read_text(encoding="utf-8", errors="replace")

    def wait(self, timeout_s: float) -> int:
        """Wait for its end and return the exit code; FleetError where time runs out."""
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            raise FleetError(
                f"{self.name} did not end within {timeout_s:g} s:\n{self.last_words}"
            ) from None

    def stop(self) -> int:
        """Interrupt it as Ctrl-C does; return the exit code."""
        self._process.send_signal(signal.SIGINT)
        return self.wait(STOP_TIMEOUT_S)

    def kill(self) -> None:
        """Kill it."""
        if self.running:
            os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()

    @property
    def last_words(self) -> str:
        """Return the last lines of its output."""
        return "\n".join(self.output.splitlines()[-15:])


class Fleet:
    """Processes in one ROS domain; leaving the context ends those that still run."""

    def __init__(self, log_folder: Path, domain_id: int) -> None:
        """Prepare the environment; logs go to ``log_folder``."""
        log_folder.mkdir(parents=True, exist_ok=True)
        self._log_folder = log_folder
        self._environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain_id),
            "ROS_LOG_DIR": str(log_folder / "ros"),
            "PYTHONUNBUFFERED": "1",
        }
        self._programs: list[Program] = []

    def start(
        self, package: str, name: str, parameters: dict[str, object] | None = None
    ) -> Program:
        """Start an executable with ROS parameters."""
        arguments = [
            f for key, value in (parameters or {}).items() for f in ("-p", f"{key}:={_yaml(value)}")
        ]
        command = [executable(package, name), *(["--ros-args", *arguments] if arguments else [])]
        program = Program(command, self._log_folder / f"{name}.log", self._environment)
        self._programs.append(program)
        return program

    def wait_for(self, program: Program, pattern: str, timeout_s: float) -> None:
        """Wait for ``pattern`` in a program's output; FleetError on an early end or timeout."""
        self.wait_until(
            lambda: re.search(pattern, program.output) is not None,
            f"{program.name} wrote {pattern!r}",
            timeout_s,
        )

    def wait_until(self, condition: Callable[[], bool], what: str, timeout_s: float) -> None:
        """Wait for a condition while all programs run; FleetError on an early end or timeout."""
        end_s = time.monotonic() + timeout_s
        while not condition():
            for program in self._programs:
                if not program.running and not condition():
                    raise FleetError(f"{program.name} ended before {what}:\n{program.last_words}")
            if time.monotonic() > end_s:
                raise FleetError(
                    f"waited {timeout_s:g} s in vain until {what}; the logs are in"
                    f" {self._log_folder}"
                )
            time.sleep(POLL_S)

    def __enter__(self) -> Self:
        """Start with no processes."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Interrupt what still runs, then kill what does not react."""
        for program in self._programs:
            try:
                if program.running:
                    program.stop()
            except FleetError:
                program.kill()


def _end_with_parent() -> None:
    """Let the kernel interrupt this process when its parent ends, even by a kill.

    Uses prctl with PR_SET_PDEATHSIG.
    """
    _LIBC.prctl(1, signal.SIGINT)


def _yaml(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
