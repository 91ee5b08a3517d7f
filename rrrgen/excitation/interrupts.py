"""Interruptions that a solver does not lose: what CasADi and IPOPT make of Ctrl-C is a failed evaluation, and go on."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def heard_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt at the end of the block if Ctrl-C came inside, whatever the code in it made of that.

    The handler that was there is called at once, as ever. Only the main thread hears signals: elsewhere, and where the
    signal is ignored or handled outside Python, this does nothing.
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
        signal.signal(signal.SIGINT, before)
        if heard:
            raise KeyboardInterrupt
