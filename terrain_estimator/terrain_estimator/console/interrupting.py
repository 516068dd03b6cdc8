# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""Clean end of a command that the user interrupts."""

import functools
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec

INTERRUPTED = 130
"""Exit code of shells: 128 plus the number of SIGINT."""
NO_MEMORY = 2
_Given = ParamSpec("_Given")


def interruptible(main: Callable[_Given, int]) -> Callable[_Given, int]:
    """Make Ctrl-C and SIGTERM end an entry point with one line instead of a traceback."""
    name = Path(main.__code__.co_filename).stem

    @functools.wraps(main)
    def run(*args: _Given.args, **kwargs: _Given.kwargs) -> int:
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            return main(*args, **kwargs)
        except KeyboardInterrupt:
            sys.stderr.write(f"{name}: interrupted\n")
            return INTERRUPTED
        except MemoryError:
            sys.stderr.write(f"{name}: the memory is full: close other programs, or give less\n")
            return NO_MEMORY
        finally:
            signal.signal(signal.SIGTERM, before)

    return run
