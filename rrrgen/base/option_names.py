"""Names of options in messages: as Python callers write them, or as flags while a command runs."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_WRITTEN: ContextVar[Callable[[str], str]] = ContextVar("written", default=str)


def option_name(name: str) -> str:
    """The name of an option as the caller writes it: ``fit_rows`` in Python, ``--fit-rows`` inside a command."""
    return _WRITTEN.get()(name)


def with_names(template: str, written: Callable[[str], str] = option_name) -> str:
    """The text of a ``template`` with every ``{option}`` in it as ``written(option)``."""
    return re.sub(r"\{(\w+)\}", lambda match: written(match.group(1)), template)


@contextmanager
def options_written(written: Callable[[str], str]) -> Iterator[None]:
    """Let messages write options as ``written(name)`` gives them."""
    before = _WRITTEN.set(written)
    try:
        yield
    finally:
        _WRITTEN.reset(before)
