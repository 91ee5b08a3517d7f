"""Passes over programs, and their interface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from rrrgen.program import OperationCount, Program


class Pass(Protocol):
    """Rewrites a program to one that computes the same with fewer operations, or returns it unchanged.

    Passes are frozen dataclasses: their fields are their options. They know ports by role, never by name.
    """

    def __call__(self, program: Program) -> Program:
        """Rewrite ``program``; returns ``program`` itself if no operation can be saved."""
        ...


@dataclass(frozen=True)
class PassReport:
    """The operations of ``function`` before and after the optimization pass ``name``."""

    name: str
    function: str
    before: OperationCount
    after: OperationCount
