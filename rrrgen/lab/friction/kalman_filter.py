"""Extended Kalman filter for position, speed, inertia, gravity and friction parameters of one joint.

The state is ``x = [q, v, p]`` with constant parameters p, some as logarithms; the acceleration is that of (14.15), in
Kostic, de Jager, Steinbuch, Robotics and Automation Handbook, CRC Press 2005, chapter 14. sgn(v) is smoothed to tanh
and the integration step is linearly implicit. Where friction jumps, the model of one sample is wrong by up to the
break-away torque: process noise on the speed accounts for it there and keeps the estimates unbiased.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.candidate_laws import Candidate
from rrrgen.lab.friction.joint_recording import JointData
from rrrgen.lab.friction.joint_simulation import Directed, Torque
from rrrgen.program import Builder, Port, Program, Role
from rrrgen.program.differentiation import jacobian

WIDTH = 3e-3  # width w of tanh(v/w) in place of sgn(v), relative to the rms speed
SLIDING_NOISE = 0.05  # standard deviation of unmodelled torque relative to the friction torque, in sliding
REVERSAL_NOISE = 1.6  # the same near rest and at changes of direction
SLOW = 0.03  # times the rms speed: slower motion counts as near rest
START_SPEED = 0.1  # standard deviation of the initial speed relative to the rms speed: the low-pass is poor there
PRIOR = 0.2  # relative standard deviation of the initial parameters
SURPRISE = 4.0  # standard deviations at which an innovation is clipped
FAR = 1.0  # rad (m) between prediction and measurement beyond which the filter has diverged
DIVERGED = 0.7  # change of the logarithm of the inertia beyond which the filter has diverged

DECLARED = "int joint_filter(double *, double *, const double *, const double *, int, const double *);"


def kalman_estimates(
    laws: Sequence[Candidate],
    starts: Sequence[Array],
    data: JointData,
    tell: Callable[[int, int], None] | None = None,
) -> list[Array]:
    """Estimate the parameters (k,) of several laws without a state by one pass of an extended Kalman filter each.

    ``starts`` are the initial parameters (k,) of each law; a law whose filter diverges keeps them. ``data`` is the
    recording. ``tell(done, total)`` is called with the number of laws.
    """
    estimates = []
    for done, (law, start) in enumerate(zip(laws, starts, strict=True)):
        if tell is not None:
            tell(done, len(laws))
        theta = _filter_recording(law, start, data)
        lost = theta is None or not abs(math.log(theta[0] / start[0])) < DIVERGED
        estimates.append(start if theta is None or lost else law.clip(theta))
    return estimates


def _filter_recording(law: Candidate, start: Array, data: JointData) -> Array | None:
    """Parameters (k,) of ``law`` after one pass over the recording, None if the filter diverged.

    The state is ``[q, v, parameters]`` without the delay, which keeps its initial value.
    """
    from rrrgen.emit.c.compilers import NATIVE
    from rrrgen.emit.c.function_files import Extension, function_files
    from rrrgen.runtime.build import build_extension

    k = len(start) - 1
    n = 2 + k
    acceleration = _acceleration(law)
    programs = [jacobian(acceleration, "a", ("x",))]
    extension = Extension("joint_filter", {"n": n})
    files = function_files("joint", "the Kalman filter of a joint", programs, "double", extension=extension)
    ffi, lib = build_extension(files, DECLARED, "joint", NATIVE)
    x, P = np.zeros(n), np.zeros((n, n))
    x[2:] = law.to_free(start)[:k]
    level = float(np.mean(np.abs(law.torque(np.array([0.5, -0.5]) * data.speed, start))))
    size = np.maximum(np.abs(start[:k]), 0.25 * level)
    P[2:, 2:] = np.diag((PRIOR * np.where(law.is_logarithmic[:k], 1.0, size)) ** 2)
    noise = max(data.resolution**2 / 12.0, 1e-24)
    torques = [SLIDING_NOISE * level, REVERSAL_NOISE * level]
    settings = [data.period, noise, *torques, SLOW * data.speed, SURPRISE, FAR, WIDTH * data.speed]
    for first, last in data.stretches:
        x[:2] = [part[first] for part in data.motion[:2]]
        P[:2], P[:, :2] = 0.0, 0.0
        P[0, 0], P[1, 1] = noise, (START_SPEED * data.speed) ** 2
        torque = Torque(data.u[first:last], np.arange(last - first)).held_torque(0, start[-1:])
        arrays = (x, P, torque, np.ascontiguousarray(data.q[first:last]))
        pointers = [ffi.from_buffer("double[]", array) for array in arrays]
        if lib.joint_filter(*pointers, last - first - 1, ffi.new("double[]", settings)):
            return None
    return np.append(law.from_free(x[2:]), start[-1])


def _acceleration(law: Candidate) -> Program:
    """The program ``acceleration(x, u, width) -> a`` of (14.15) with sgn(v) replaced by ``tanh(v / width)``.

    ``x`` is ``[q, v, parameters]``, some of them as logarithms.
    """
    builder = Builder()
    k = len(law.names) - 1
    x = builder.input(Port("x", (2 + k,), "mixed", "", "position, speed, parameters"))
    u = builder.input(Port("u", (1,), "N m | N", "joint", "torque", Role.TORQUE))
    width = builder.input(Port("width", (1,), "rad/s | m/s", "", "speed at which the sign is smoothed"))
    q, v, *free = x
    logs = law.is_logarithmic
    theta = [builder.exp(value) if log else value for value, log in zip(free, logs[:k], strict=True)] + [Fraction(0)]
    smooth = Directed(builder, builder.tanh(v / width[0]))
    friction = law.law.torque(smooth, v, law.law_values(theta))
    a = (u[0] - law.gravity_torque(q, theta, builder) - friction) / theta[0]
    port = Port("a", (1,), "rad/s^2 | m/s^2", "", "acceleration")
    return builder.program("acceleration", [(port, [a])], summary="Acceleration of one joint.")
