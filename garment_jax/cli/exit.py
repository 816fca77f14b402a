"""The end of the process: after Ctrl-C at once, whatever is being compiled."""

import multiprocessing
import os
import sys
from contextlib import suppress
from typing import NoReturn

INTERRUPTED = 130  # 128 + SIGINT, as shells have it


def leave(code: int) -> NoReturn:
    """End the process with `code`.

    An interpreter that ends waits for its threads, and one inside XLA's compiler cannot be stopped: up to a
    minute. All files are closed and all temporary ones gone when `code` says that the user interrupted.
    """
    if code == INTERRUPTED:
        for worker in multiprocessing.active_children():  # of a pool whose end a second Ctrl-C cut short
            worker.terminate()
        with suppress(OSError, ValueError):  # closed, or nobody reads
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)
    sys.exit(code)
