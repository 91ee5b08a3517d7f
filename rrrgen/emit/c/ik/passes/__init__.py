"""Passes over the loop nest of an inverse kinematics, in the order in which they run."""

from __future__ import annotations

from typing import Protocol

from rrrgen.emit.c.ik.loop_nest import DropUnused, Hoist, LoopNest, TakeArcsTogether


class LoopPass(Protocol):
    """Rewrites a loop nest to one that finds the same candidates with less work, or returns it unchanged.

    Passes are frozen dataclasses: their fields are their options.
    """

    def __call__(self, nest: LoopNest) -> LoopNest:
        """The rewritten nest."""
        ...


PASSES: tuple[LoopPass, ...] = (DropUnused(), Hoist(), TakeArcsTogether())
