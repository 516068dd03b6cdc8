# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Clean end and clean output of a command."""

import functools
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec

from rover_parameters.printable import printable_output

INTERRUPTED = 130
"""Exit code of shells: 128 plus the number of SIGINT."""
NO_MEMORY = 2
_Given = ParamSpec("_Given")


def interruptible(main: Callable[_Given, int]) -> Callable[_Given, int]:
    """Make Ctrl-C and SIGTERM end an entry point with one line instead of a traceback.

    All that it prints is printable (:mod:`rover_parameters.printable`): names from bags and files
    can hold characters that a terminal obeys.
    """
    name = Path(main.__code__.co_filename).stem

    @functools.wraps(main)
    def run(*args: _Given.args, **kwargs: _Given.kwargs) -> int:
        # elsewhere, as in a worker of dask, signals are not ours to handle
        first = threading.current_thread() is threading.main_thread()
        before = signal.signal(signal.SIGTERM, signal.default_int_handler) if first else None
        try:
            with printable_output():
                return main(*args, **kwargs)
        except KeyboardInterrupt:
            sys.stderr.write(f"{name}: interrupted\n")
            return INTERRUPTED
        except MemoryError:
            sys.stderr.write(f"{name}: the memory is full: close other programs, or give less\n")
            return NO_MEMORY
        finally:
            if first:
                signal.signal(signal.SIGTERM, before)

    return run
