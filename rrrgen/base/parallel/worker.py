"""Entry point of the processes that :mod:`rrrgen.base.parallel.fresh` starts: they compute tasks on request.

The parent writes pickles to standard input: a pair of a function and its tasks, then one index after the other, and
after the last one perhaps another pair. Every answer on standard output is a pickled result. A task that fails ends the
process; the parent repeats it.
"""

from __future__ import annotations

import contextlib
import gc
import os
import pickle
import sys


def serve() -> None:
    """Answer the requests of the parent process until it closes standard input."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries that print must not disturb the answers
    gc.disable()  # programs hold no reference cycles, and the search takes a tenth of the time
    with contextlib.suppress(EOFError, BrokenPipeError, KeyboardInterrupt):
        while True:
            request = pickle.load(sys.stdin.buffer)
            if isinstance(request, tuple):
                function, tasks = request
                continue
            pickle.dump(function(tasks[request]), answers, pickle.HIGHEST_PROTOCOL)
            answers.flush()
