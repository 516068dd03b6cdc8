# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How commands end that a user does not wait for."""

import functools
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec

INTERRUPTED = 130
"""Exit code, as shells have it: 128 and the number of SIGINT."""
_Given = ParamSpec("_Given")


def interruptible(main: Callable[_Given, int]) -> Callable[_Given, int]:
    """An entry point that Ctrl-C ends with one line in place of a traceback, and SIGTERM in the same way: by KeyboardInterrupt."""
    name = Path(main.__code__.co_filename).stem

    @functools.wraps(main)
    def run(*args: _Given.args, **kwargs: _Given.kwargs) -> int:
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)
        try:
            return main(*args, **kwargs)
        except KeyboardInterrupt:
            sys.stderr.write(f"{name}: interrupted\n")
            return INTERRUPTED
        finally:
            signal.signal(signal.SIGTERM, before)

    return run
