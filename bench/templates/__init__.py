"""C and C++ files for the contenders: the timing driver, the adapter for Pinocchio, an arm solved by hand."""

from __future__ import annotations

from pathlib import Path

from rrrgen.base.templates import environment


def source(name: str) -> str:
    """The text of the file ``name`` beside this one."""
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


def render(name: str, **values: object) -> str:
    """The template ``name`` beside this file, filled with ``values``."""
    return environment().from_string(source(name)).render(**values)
