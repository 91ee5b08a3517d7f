"""The tables of the public model functions, in the order of emission; each module ends with its part of them.

The group "model" is always emitted. The functions of the other groups are needed by some users only, and are derived
and emitted on request.
"""

from __future__ import annotations

from rrrgen.derive.functions import (
    derivatives,
    dynamic_functions,
    energy_functions,
    kinematic_functions,
    parameter_functions,
    point_functions,
    regressor_functions,
)
from rrrgen.derive.functions.control import contact, elastic, laws, motions, observers, operational, paths, terms
from rrrgen.derive.functions.recording import Recorder

FUNCTIONS: dict[str, tuple[Recorder, ...]] = {
    **kinematic_functions.FUNCTIONS,
    **dynamic_functions.FUNCTIONS,
    **derivatives.FUNCTIONS,
    **regressor_functions.FUNCTIONS,
    **energy_functions.FUNCTIONS,
    **parameter_functions.FUNCTIONS,
}
"""Public function of the group "model" -> recorders of one or more equivalent programs."""

GROUPS: dict[str, dict[str, tuple[Recorder, ...]]] = {
    "model": FUNCTIONS,
    "points": point_functions.FUNCTIONS,
    "control": {**terms.FUNCTIONS, **laws.FUNCTIONS, **operational.FUNCTIONS},
    "observer": {**observers.FUNCTIONS, **contact.FUNCTIONS},
    "elastic": elastic.FUNCTIONS,
    "timing": paths.FUNCTIONS,
    "trajectory": motions.FUNCTIONS,
}
"""Name of a group -> its functions."""

MORE_JOINTS_THAN = {
    **point_functions.MORE_JOINTS_THAN,
    **operational.MORE_JOINTS_THAN,
    **contact.MORE_JOINTS_THAN,
}
"""Functions that exist only for arms with more joints than this."""


def functions_of(group: str, joints: int) -> dict[str, tuple[Recorder, ...]]:
    """The functions of ``group`` that exist for a robot with so many joints."""
    return {name: recorders for name, recorders in GROUPS[group].items() if joints > MORE_JOINTS_THAN.get(name, 0)}
