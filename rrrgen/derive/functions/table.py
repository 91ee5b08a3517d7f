"""The table of all model functions, by group and in the order of emission, put together from those of the modules.

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
"""The functions of the group "model", each with the recorders of one or more equivalent programs."""

GROUPS: dict[str, dict[str, tuple[Recorder, ...]]] = {
    "model": FUNCTIONS,
    "points": point_functions.FUNCTIONS,
    "control": {**terms.FUNCTIONS, **laws.FUNCTIONS, **operational.FUNCTIONS},
    "observer": {**observers.FUNCTIONS, **contact.FUNCTIONS},
    "elastic": elastic.FUNCTIONS,
    "timing": paths.FUNCTIONS,
    "trajectory": motions.FUNCTIONS,
}
"""The functions of each group, by the name of the group."""

MORE_JOINTS_THAN = {
    **point_functions.MORE_JOINTS_THAN,
    **operational.MORE_JOINTS_THAN,
    **contact.MORE_JOINTS_THAN,
}
"""Functions that exist only for arms with more joints than this."""


def functions_of(group: str, joints: int) -> dict[str, tuple[Recorder, ...]]:
    """The functions of ``group`` that exist for a robot with this number of ``joints``, by name.

    Several recorders of one function derive equivalent programs, among which the optimizer chooses.
    """
    return {name: recorders for name, recorders in GROUPS[group].items() if joints > MORE_JOINTS_THAN.get(name, 0)}
