"""The table of contents of the compiler: description -> model -> programs -> cheaper programs -> files."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.spec.robot_spec import RobotSpec


def derive(spec: RobotSpec) -> DerivedModel:
    """All programs of ``spec``, optimized, with their nominal twins."""
    from rrrgen.derive import derive_model
    from rrrgen.optimize import optimize

    return optimize(derive_model(spec))
