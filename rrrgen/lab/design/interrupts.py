"""Makes Ctrl-C end work in CasADi: an interruption that its solver or its Python code swallows is raised again.

IPOPT takes an interruption for a failed evaluation and goes on from another point. The Python code of CasADi catches
every exception in some places (``vertcat`` and the conversion of arrays, for instance), the interruption among them.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def reraised_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end of the block if Ctrl-C was pressed in it, even if its code swallowed that.

    The previous signal handler is still called at once. Has no effect outside the main thread, which alone receives
    signals, or if the signal is ignored or handled outside Python. Blocks may be nested; also usable as a decorator.
    """
    before: Any = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    heard = False

    def remember(number: int, frame: Any) -> None:
        nonlocal heard
        heard = True
        before(number, frame)

    signal.signal(signal.SIGINT, remember)
    try:
        yield
    finally:
        try:
            signal.signal(signal.SIGINT, before)
        except BaseException:  # a signal that waited is handled before the handler is replaced: replace it again
            signal.signal(signal.SIGINT, before)
            raise
        if heard:
            raise KeyboardInterrupt
