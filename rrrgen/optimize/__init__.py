"""Optimization of programs: passes that reduce the operations of a function, and the order in which they run.

A pass turns a program into an equivalent one; every pass is reported with the operations before and after it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel, RecordedModel
    from rrrgen.parallel_map import Tell


def optimize(recorded: RecordedModel, jobs: int = 1, tell: Tell | None = None) -> DerivedModel:
    """Optimize every function of ``recorded``; the result holds the optimized programs and a report of each pass.

    Functions of the base parameters gain a ``_nominal`` specialization with the numbers of the robot file. ``jobs`` is
    the largest number of processes; the result does not depend on it. ``tell(done, total, message)`` is called as
    functions are done.
    """
    from rrrgen.optimize.optimizer import Optimizer

    return Optimizer()(recorded, jobs, tell)
