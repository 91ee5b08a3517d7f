"""Calls from Python: the time of one evaluation through each interface."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import util
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.contenders.cases import Case
from bench.contenders.contender import DisagreementError
from bench.measurements.race import TOLERANCE
from bench.toolchain import Toolchain, run
from rrrgen.verify.references.numeric_robot import Array, NumericRobot

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model

PIN = "pin.rnea"
BOUND_RUN, BOUND = "rrrgen bound, run()", "rrrgen bound, call"
BOUND_COPY, PLAIN = "rrrgen bound, call with three arrays", "rrrgen plain call"


@dataclass(frozen=True)
class CallTime:
    """Nanoseconds of one Python call of inverse dynamics."""

    robot: str
    interface: str
    nanoseconds: float


def python_calls(case: Case, model: Model, toolchain: Toolchain, rounds: int) -> list[CallTime]:
    """Inverse dynamics with the file's numbers through every interface that is installed, in turns."""
    state = tuple(np.ascontiguousarray(part[0]) for part in case.parts()[:3])
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        calls = {**_own_calls(model, state), **_pinocchio_calls(case, state)}
        calls |= _casadi_calls(case, state, toolchain, Path(place))
        wanted = case.references["file"].values["inverse_dynamics"][0]
        for name, call in calls.items():
            call()
            error = np.max(np.abs(np.ravel(call()) - wanted)) / np.max(np.abs(wanted))
            if not error < TOLERANCE:
                raise DisagreementError(f"{case.name}: {name} differs from the reference by {error:.1e}")
        bound = model.bind("inverse_dynamics")  # the bare call returns nothing to check; its values were just checked
        bound(*state)
        best = turns({BOUND_RUN: bound.run, **calls}, rounds, 1e-3)
    return [CallTime(case.name, name, 1e9 * seconds) for name, seconds in best.items()]


def turns(calls: Mapping[str, Callable[[], Any]], rounds: int, sample: float) -> dict[str, float]:
    """The smallest seconds per call. The calls alternate, each for about ``sample`` seconds at a time."""
    numbers: dict[str, int] = {}
    for name, call in calls.items():
        start = time.perf_counter()
        call()
        numbers[name] = max(1, int(sample / max(time.perf_counter() - start, 1e-7)))
    best = dict.fromkeys(calls, np.inf)
    for _ in range(rounds):
        for name, call in calls.items():
            number = numbers[name]
            start = time.perf_counter()
            for _ in range(number):
                call()
            best[name] = min(best[name], (time.perf_counter() - start) / number)
    return {name: float(value) for name, value in best.items()}


def _own_calls(model: Model, state: tuple[Array, ...]) -> dict[str, Callable[[], Any]]:
    bound = model.bind("inverse_dynamics")
    for array, value in zip(bound.inputs.values(), state, strict=False):
        array[...] = value
    copying = model.bind("inverse_dynamics")
    return {
        BOUND: bound,
        BOUND_COPY: lambda: copying(*state),
        PLAIN: lambda: model.inverse_dynamics(*state),
    }


def _pinocchio_calls(case: Case, state: tuple[Array, ...]) -> dict[str, Callable[[], Any]]:
    if util.find_spec("pinocchio") is None:
        return {}
    import pinocchio as pin

    model = pinocchio_model(case.chain, case.phi("file"))
    data = model.createData()
    return {PIN: lambda: pin.rnea(model, data, *state)}


def pinocchio_model(chain: NumericRobot, phi: Array) -> Any:
    """A chain of revolute joints as ``pinocchio.Model``."""
    import pinocchio as pin

    from rrrgen.verify.references.numeric_robot import centre_and_tensor

    model = pin.Model()
    model.gravity.linear = chain.gravity
    offset, parent = chain.base, 0
    for i, (before, after) in enumerate(chain.around_joints()):
        parent = model.addJoint(parent, pin.JointModelRZ(), pin.SE3(offset @ before), f"joint{i + 1}")
        centre, tensor = centre_and_tensor(phi[i])
        model.appendBodyToJoint(parent, pin.Inertia(float(phi[i, 0]), centre, tensor), pin.SE3(after))
        offset = after
    return model


def _casadi_calls(
    case: Case, state: tuple[Array, ...], toolchain: Toolchain, place: Path
) -> dict[str, Callable[[], Any]]:
    """The hand-made function, compiled, through CasADi's two interfaces."""
    if util.find_spec("casadi") is None or not all(case.chain.revolute):
        return {}
    import casadi as ca

    from bench.contenders.casadi_code import c_source
    from bench.contenders.hand_casadi import hand_functions
    from bench.contenders.joint_frames import joint_frames

    hand = hand_functions(joint_frames(case.chain, case.phi("file")), ["inverse_dynamics"])
    source, library = place / "hand.c", place / "hand.so"
    source.write_text(c_source(hand), encoding="utf-8")
    run([*toolchain.cc, *toolchain.flags, "-shared", "-fPIC", str(source), "-lm", "-o", str(library)])
    function = ca.external("hand_inverse_dynamics", str(library))
    buffer: Any
    buffer, trigger = function.buffer()
    result = np.zeros(case.n)
    for place_in, value in enumerate(state):
        buffer.set_arg(place_in, value.data)
    buffer.set_res(0, result.data)

    def buffered(owned: Any = (buffer, state)) -> Array:  # the trigger owns neither
        trigger()
        return result

    return {"CasADi buffer": buffered, "CasADi plain call": lambda: function(*state).full()}
