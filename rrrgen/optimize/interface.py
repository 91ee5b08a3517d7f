"""The interface of optimization passes."""

from __future__ import annotations

from typing import Protocol

from rrrgen.program import Program


class Pass(Protocol):
    """Rewrites a program to one that computes the same with fewer operations, or returns it unchanged.

    Passes are frozen dataclasses: their fields are their options. They know ports by role, never by name.
    """

    def __call__(self, program: Program) -> Program:
        """Rewrite ``program``; returns ``program`` itself if no operation can be saved."""
        ...
