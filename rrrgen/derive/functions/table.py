"""The table of the public model functions, in the order of emission; every module lists its own at its end."""

from __future__ import annotations

from rrrgen.derive.functions import (
    derivatives,
    dynamic_functions,
    energy_functions,
    kinematic_functions,
    regressor_functions,
)
from rrrgen.derive.functions.recording import Recorder

FUNCTIONS: dict[str, tuple[Recorder, ...]] = {
    **kinematic_functions.FUNCTIONS,
    **dynamic_functions.FUNCTIONS,
    **derivatives.FUNCTIONS,
    **regressor_functions.FUNCTIONS,
    **energy_functions.FUNCTIONS,
}
"""Functions recorded from the derivations, each in one or more equivalent ways."""
