# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Faults of the node's surroundings: the middleware, its files, the operating system."""

import shutil
import signal
from pathlib import Path

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.qos import QoSProfile, ReliabilityPolicy

from terrain_estimator.model.metadata import MODELS
from tests.faults.fault import Expected
from tests.faults.rover import Rover
from tests.faults.through import of_estimator
from tests.faults.values import FAULT_S, TAKEN
from tests.system.listening import RELIABLE
from tests.system.processes import Process

BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
STOPPED_S, DEAD_S = 3.0, 2.0


def _wrong_qos(rover: Rover, _: Process) -> None:
    rover.advertise("wheel_slip", BEST_EFFORT)
    rover.drive(FAULT_S, sound=False)
    rover.advertise("wheel_slip", RELIABLE)


def _own_model(folder: Path) -> dict[str, str]:
    """Provide a copy of the model that can be replaced."""
    for suffix in (".pt", ".json"):
        shutil.copy(MODELS / f"mars_rover{suffix}", folder / f"model{suffix}")
    return {"model": str(folder / "model.pt")}


def _swap_model(rover: Rover, _: Process) -> None:
    shutil.copy(MODELS / "paper_rover.pt", rover.folder / "model.pt")
    rover.drive(FAULT_S)


def _configure_swapped_model(rover: Rover, estimator: Process) -> None:
    shutil.copy(MODELS / "paper_rover.pt", rover.folder / "model.pt")
    for transition in (
        Transition.TRANSITION_DEACTIVATE,
        Transition.TRANSITION_CLEANUP,
        Transition.TRANSITION_CONFIGURE,
    ):
        _change(rover, transition)
    estimator.wait_for_output("the node stays unconfigured")
    rover.drive(FAULT_S, sound=False)
    _own_model(rover.folder)
    for transition in (Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE):
        _change(rover, transition)


def _change(rover: Rover, transition: int) -> None:
    rover.listener.call(
        ChangeState,
        "estimator/change_state",
        ChangeState.Request(transition=Transition(id=transition)),
    )


def _stop(rover: Rover, estimator: Process) -> None:
    estimator.signal(signal.SIGSTOP)
    rover.drive(STOPPED_S)
    estimator.signal(signal.SIGCONT)


def _with_state(folder: Path) -> dict[str, str]:
    """Keep the state in a folder of its own."""
    (folder / "kept").mkdir(exist_ok=True)
    return {"state.file": str(folder / "kept" / "ground.state"), "state.autosave_period": "0.2"}


def _lose_the_folder(rover: Rover, _: Process) -> None:
    kept = rover.folder / "kept"
    gone = kept.rename(rover.folder / "gone")
    rover.drive(FAULT_S)
    gone.rename(kept)


def _kill(rover: Rover, estimator: Process) -> None:
    estimator.kill()
    rover.drive(DEAD_S)
    rover.end_fault()
    rover.match(rover.estimator(_with_state(rover.folder)))


WRONG_QOS = Expected(
    frozenset({"none"}),
    {"losses": "WARN", "publishers": "ERROR", "required input": "STALE"},
    log=(
        "^wheel_slip: incompatible quality of service with /listener_[0-9]+: .*reliab",
        r"^no data on wheel_slip for [0-9.]+ s",
        "^New publisher discovered on topic 'wheel_slip', offering incompatible QoS",
    ),
)
WRONG_MODEL = Expected(
    frozenset({"none"}),
    {"lifecycle": "ERROR"},
    log=(r"^cannot configure: .*model\.pt: has [0-9]+ bytes, model\.json says [0-9]+",),
    kept=False,
)
NOT_SAVED = Expected(
    frozenset({"ACCEPTED"}),
    {"saved state": "WARN"},
    log=(
        r"^cannot write the state to .*No such file or directory.*; trying on$",
        r"^the state of [0-9]+ s ago is not in .* yet: .*No such file or directory",
    ),
)
KILLED = Expected(
    frozenset({"none"}), {}, frozenset({"required input"}), lost=20
)  # "since the start", where that takes a second
# DDS delivers all messages of the stop in some runs, none in others; reconnecting takes a second
STOPPED = Expected(
    frozenset({"ACCEPTED", "none"}),
    {},
    frozenset({"latency", "losses", "optional input", "required input"}),
    back_after=30,
    lost=60,
    at_most=True,
)
FAULTS = (
    of_estimator(
        "wrong QoS",
        "wheel_slip is published best effort, which a reliable subscription does not match",
        _wrong_qos,
        WRONG_QOS,
    ),
    of_estimator(
        "model swapped",
        "the .pt file is replaced by another rover's while the node runs",
        _swap_model,
        TAKEN,
        _own_model,
    ),
    of_estimator(
        "model swapped, configured anew",
        "the same, and the node is configured anew; then the right file is put back",
        _configure_swapped_model,
        WRONG_MODEL,
        _own_model,
    ),
    of_estimator(
        "state cannot be written",
        "the folder of state.file is renamed while the node runs",
        _lose_the_folder,
        NOT_SAVED,
        _with_state,
    ),
    of_estimator(
        "SIGSTOP then SIGCONT",
        f"the estimator is stopped for {STOPPED_S:g} s while the rover drives on",
        _stop,
        STOPPED,
    ),
    of_estimator(
        "kill -9 and restart",
        f"the estimator is killed, and started again after {DEAD_S:g} s of driving; its state is"
        " written every 0.2 s",
        _kill,
        KILLED,
        _with_state,
    ),
)
