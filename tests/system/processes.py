# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Real processes of installed packages: started, watched, signalled, and never left behind."""

import os
import re
import signal
import subprocess
from pathlib import Path
from types import TracebackType
from typing import Self

from ament_index_python.packages import get_package_prefix

from tests.system.waiting import PATIENCE_S, wait_until


class Process:
    """Process of an executable, with stdout and stderr in one file in the order of writing."""

    def __init__(self, command: list[str], log: Path, environment: dict[str, str]) -> None:
        self.log = log
        self.name = Path(command[0]).name
        with log.open("wb") as stream:
            # A session of its own: a signal meant for the tests does not reach it, and its children
            # can be ended with it.
            # A shell that runs the tests in the background ignores SIGINT, and so would all that
            # they start.
            command = ["env", "--default-signal=INT", *command]
            self._process = subprocess.Popen(
                command,
                stdout=stream,
                stderr=subprocess.STDOUT,
                env=environment,
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Process number."""
        return self._process.pid

    @property
    def output(self) -> str:
        """All output so far."""
        return self.log.read_text(encoding="utf-8", errors="replace")

    @property
    def running(self) -> bool:
        """True until the process ends."""
        return self._process.poll() is None

    def wait_for_output(self, pattern: str, timeout: float = PATIENCE_S) -> re.Match[str]:
        """Return the first match of a regular expression in the output.

        Fails at once where the process ends without it.
        """

        def found() -> re.Match[str] | None:
            running = self.running
            match = re.search(pattern, self.output, re.MULTILINE)
            assert match or running, (
                f"{self.name} ended with {self._process.returncode} without writing"
                f" {pattern!r}:\n{self.output}"
            )
            return match

        match = wait_until(
            found, f"{self.name} writes {pattern!r}", timeout, lambda: f"Its output:\n{self.output}"
        )
        assert match is not None
        return match

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to the process."""
        self._process.send_signal(number)

    def wait(self, timeout: float = PATIENCE_S) -> int:
        """Wait for the end; return the exit code, negative for the signal that ended it."""
        try:
            return self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise AssertionError(
                f"{self.name} did not end within {timeout:g} s. Its output:\n{self.output}"
            ) from None

    def interrupt(self, timeout: float = PATIENCE_S) -> int:
        """Send SIGINT, as Ctrl-C does; return the exit code."""
        self.signal(signal.SIGINT)
        return self.wait(timeout)

    def terminate(self, timeout: float = PATIENCE_S) -> int:
        """Send SIGTERM, as a service manager does; return the exit code."""
        self.signal(signal.SIGTERM)
        return self.wait(timeout)

    def kill(self) -> int:
        """Kill the process and its children; return the exit code."""
        if self.running:
            os.killpg(self.pid, signal.SIGKILL)
        return self.wait()


class Starter:
    """Starter of executables in one ROS domain, which ends them after the test."""

    def __init__(self, folder: Path, domain_id: int) -> None:
        self.folder = folder
        self.environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain_id),
            "ROS_LOG_DIR": str(folder / "ros_log"),
            "PYTHONUNBUFFERED": "1",
            "PYTHONWARNINGS": "",
        }
        self._processes: list[Process] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        killed = [process for process in self._processes if process.running]
        for process in killed:
            process.kill()
        if any(process.wait() < 0 for process in self._processes):
            # A killed process leaves its shared-memory files behind. Housekeeping only, and the
            # wheel for Python 3.13 lacks the tool.
            subprocess.run(["fastdds", "shm", "clean"], check=False, capture_output=True)

    def __call__(self, package: str, executable: str, *arguments: str) -> Process:
        """Start an executable of an installed package."""
        return self.command(
            str(Path(get_package_prefix(package), "lib", package, executable)), *arguments
        )

    def command(self, program: str, *arguments: str) -> Process:
        """Start any program."""
        log = self.folder / f"{len(self._processes)}_{Path(program).name}.log"
        process = Process([program, *arguments], log, self.environment)
        self._processes.append(process)
        return process
