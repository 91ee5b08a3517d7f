"""The table of the public model functions: how each is recorded, in one or more equivalent ways."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from rrrgen.derive.functions import dynamic_functions as dynamic
from rrrgen.derive.functions import kinematic_functions as kinematic
from rrrgen.derive.functions import regressor_functions as regressors
from rrrgen.derive.functions.derivatives import forward_dynamics_derivatives, inverse_dynamics_derivatives
from rrrgen.derive.functions.dynamic_functions import block_frames, own_frames
from rrrgen.derive.functions.recording import Recording
from rrrgen.derive.recursions.regressor import columns_by_axes, columns_passed_down
from rrrgen.program import Program

Recorder: TypeAlias = Callable[[Recording], Program]

FUNCTIONS: dict[str, tuple[Recorder, ...]] = {
    "forward_kinematics": (kinematic.forward_kinematics, kinematic.forward_kinematics_inwards),
    "link_frames": (kinematic.link_frames,),
    "jacobian": (kinematic.jacobian,),
    "kinematics": (kinematic.kinematics,),
    "jacobian_dot_dq": (kinematic.jacobian_dot_dq,),
    "mass_matrix": (dynamic.mass_matrix,),
    "coriolis_matrix": (dynamic.coriolis_matrix,),
    "coriolis": (dynamic.coriolis(block_frames), dynamic.coriolis(own_frames)),
    "coriolis_transpose": (dynamic.coriolis_transpose,),
    "gravity": (dynamic.gravity,),
    "bias": (dynamic.bias(block_frames), dynamic.bias(own_frames)),
    "dynamics_terms": (dynamic.dynamics_terms(block_frames), dynamic.dynamics_terms(own_frames)),
    "inverse_dynamics": (dynamic.inverse_dynamics(block_frames), dynamic.inverse_dynamics(own_frames)),
    "inverse_dynamics_derivatives": (inverse_dynamics_derivatives,),
    "forward_dynamics_derivatives": (forward_dynamics_derivatives,),
    "regressor": tuple(
        regressors.regressor(columns, frames)
        for columns in (columns_by_axes, columns_passed_down)
        for frames in (own_frames, block_frames)
    ),
    "regressor_transpose": (regressors.regressor_transpose,),
    "standard_regressor": (regressors.standard_regressor,),
    "energy": (dynamic.energy,),
}
"""Functions recorded from the derivations, in the order of emission, each in one or more equivalent ways."""
