"""The table of the public model functions, in the order of emission; each module ends with its part of it."""

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
"""Public function -> recorders of one or more equivalent programs."""
