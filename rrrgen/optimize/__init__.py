"""From programs to cheaper programs: one pass per module, each with its operations before and after."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel, RecordedModel


def optimize(recorded: RecordedModel, jobs: int = 1) -> DerivedModel:
    """The functions of ``recorded`` at their cheapest, nominal specializations added, and a report of each pass.

    The result does not depend on ``jobs``, the processes at work.
    """
    from rrrgen.optimize.optimizer import Optimizer

    return Optimizer()(recorded, jobs)
