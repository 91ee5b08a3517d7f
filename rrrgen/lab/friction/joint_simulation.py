"""Simulation of one joint over many short windows, in compiled C, with exact derivatives of the positions.

A step is recorded once as a program of the state, the torque and the parameters; automatic differentiation gives its
Jacobians, and these carry the derivatives of the positions by parameters and initial states along the motion. So the
exponentials of a friction law are computed once a step, not once for every shifted parameter. With a friction law that
jumps at zero speed, a joint sticks exactly while the load is below break-away; the time at which it stops is located
within a time step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.candidate_laws import Candidate
from rrrgen.program import Builder, Port, Program, Role
from rrrgen.program.builder import replay
from rrrgen.program.differentiation import jacobian

LUGRE_STEPS = (4, 20)
"""Fewest and most steps within a sampling period of about 1 ms: bristles are stiff."""
RESOLVED = 0.16  # angle, in rad, by which the joint on its bristles may oscillate within a step
MEAN_SPEEDS = 3  # iterations for the mean speed of a step
RINGING_SPEED = 2.0  # times the speed to which bristles bent to break-away accelerate the joint
SMALLEST = Fraction(1, 10**8)  # least share of the deflection that is forgotten in a step: a smaller one loses digits
NEURAL_STEPS = 4
HALF = Fraction(1, 2)

DECLARED = (
    "void joint_simulate(const double *, int, const int *, const int *, const double *, int, const double *, "
    "const double *, const int *, const int *, int, const double *, const double *, double *, double *);"
)


@dataclass(frozen=True)
class Torque:
    """Recorded torque over S windows.

    ``samples`` (N,) is the torque of the whole recording, ``starts`` (S,) the first sample of each window.
    """

    samples: Array
    starts: NDArray[np.int64]

    def held_torque(self, step: int, delay: Array) -> Array:
        """Torque (C, S) during sampling period number ``step`` of each window, delayed by ``delay`` (C, 1) periods.

        A fractional delay interpolates between two periods.
        """
        at = self.starts + step - delay
        low = np.floor(at).astype(np.int64)
        weight = at - low
        last = len(self.samples) - 1
        first, second = np.clip(low, 0, last), np.clip(low + 1, 0, last)
        return np.asarray((1.0 - weight) * self.samples[first] + weight * self.samples[second])

    def centred_torque(self, delay: Array) -> Array:
        """Torque (C, S) at the start of each window: the mean of the values held before and after that time."""
        return 0.5 * (self.held_torque(0, delay) + self.held_torque(-1, delay))


@dataclass(frozen=True, eq=False)
class Windows:
    """A recording cut into S short windows over which the joint is simulated.

    ``period`` is the sampling period (s), ``torque`` the recorded torque of the windows. Positions are compared every
    ``stride`` periods: ``measured`` (m, S) are the recorded ones, rad (m), and ``used`` (m, S) marks those that belong
    to a window, which may be shorter than the longest. ``q0``, ``v0`` (S,) are estimated positions and speeds at the
    start, with the standard deviations ``q0_std``, ``v0_std``. ``block`` (S,) is the number of the longer stretch that
    a window belongs to; blocks are held out or resampled as a whole. ``resolution`` is that of the encoder, rad (m).
    ``direction`` (S,), +1 or -1, is the direction of sliding if it is constant in each window, otherwise None.
    ``a0`` (S,) is the acceleration at the start, ``smoothed`` the torque after the low-pass filter that gave it.
    """

    period: float
    stride: int
    torque: Torque
    smoothed: Torque
    measured: Array
    q0: Array
    v0: Array
    a0: Array
    q0_std: float
    v0_std: float
    used: NDArray[np.bool_]
    block: NDArray[np.int64]
    resolution: float
    direction: Array | None = None

    def __len__(self) -> int:
        return len(self.q0)

    @property
    def points(self) -> int:
        """Number of positions that are compared, over all windows."""
        return int(np.count_nonzero(self.used))

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Sampling periods (S,) from the first to the last position that is compared."""
        return np.asarray((np.count_nonzero(self.used, axis=0) - 1) * self.stride)

    def of(self, chosen: NDArray[Any]) -> Windows:
        """The ``chosen`` windows, given by a mask (S,) or by their numbers."""
        torque, smoothed = (replace(signal, starts=signal.starts[chosen]) for signal in (self.torque, self.smoothed))
        return replace(
            self, torque=torque, smoothed=smoothed, measured=self.measured[:, chosen],
            q0=self.q0[chosen], v0=self.v0[chosen], a0=self.a0[chosen],
            direction=None if self.direction is None else self.direction[chosen],
            used=self.used[:, chosen], block=self.block[chosen],
        )  # fmt: skip


@dataclass(frozen=True)
class Directed:
    """Operations of a ``builder`` for friction laws, with sgn(dq) replaced by the ``direction`` of sliding.

    Thus ``|u| = u sgn(u)`` stays smooth in u, and friction at rest has the direction in which the joint is about to
    slide.
    """

    builder: Any
    direction: Any

    def exp(self, x: Any) -> Any:
        """exp(x)."""
        return self.builder.exp(x)

    def tanh(self, x: Any) -> Any:
        """tanh(x)."""
        return self.builder.tanh(x)

    def sign(self, x: Any) -> Any:
        """The direction of sliding, whatever the argument ``x``."""
        return self.direction


class JointSimulation:
    """Simulation of the joint that ``candidate`` describes, compiled once for all values of its parameters.

    ``slides`` says that the joint slides in a given direction all the time, even where a simulation with wrong
    parameters would stop: then positions are smooth functions of the parameters.
    """

    def __init__(self, candidate: Candidate, slides: bool) -> None:
        from rrrgen.emit.c.compilers import NATIVE
        from rrrgen.emit.c.function_files import Extension, function_files
        from rrrgen.runtime.build import build_extension

        self.candidate = candidate
        step = joint_step(candidate, slides)
        programs = [step, jacobian(step, "after", ("x", "u", "theta"))]
        self.n = programs[0].inputs[0].size
        self.most = len(candidate.names) + self.n
        extension = Extension("joint_windows", {"n": self.n, "k": len(candidate.names), "most": self.most})
        files = function_files("joint", "the windows of a joint", programs, "double", extension=extension)
        self._ffi, self._lib = build_extension(files, DECLARED, "joint", NATIVE)

    def positions(
        self,
        theta: Array,
        windows: Windows,
        start: Array,
        seeds: Sequence[int] = (),
        slopes: Array | None = None,
    ) -> tuple[Array, Array]:
        """Positions (m, S) at the times that are compared, rad or m, and their derivatives (m, c, S).

        ``theta`` (k,) are the parameters, ``start`` (s, S) the states at the start of the ``windows``: position, speed
        and deflection of the bristles of a law with a state. Derivative number j is by the parameter ``seeds[j]``; a
        negative one stands for an initial state. ``slopes`` (s, c, S) are the derivatives of the start. Positions after
        the end of a window are 0.
        """
        count, points, columns = len(windows), len(windows.measured), len(seeds)
        positions, rows = np.zeros((count, points)), np.zeros((count, points, columns))
        steps, slow = self._steps(theta, windows.period)
        reals = [
            windows.torque.samples,
            np.zeros(count) if windows.direction is None else windows.direction,
            *(theta, np.array([windows.period, slow]), start.T),
            np.zeros((count, self.n, columns)) if slopes is None else slopes.transpose(2, 0, 1),
        ]
        u, d, parameters, settings, x, S = (self._doubles(array) for array in reals)
        first, periods, counts, chosen = (
            self._ffi.from_buffer("int[]", np.ascontiguousarray(integers, np.int32))
            for integers in (windows.torque.starts, windows.lengths, [windows.stride, *steps, points], [*seeds, -1])
        )
        derivatives = self._doubles(rows) if columns else self._ffi.NULL
        self._lib.joint_simulate(
            u, len(windows.torque.samples), first, periods, d, count, parameters, settings, counts, chosen, columns,
            x, S, self._doubles(positions), derivatives,
        )  # fmt: skip
        return positions.T, rows.transpose(1, 2, 0)

    def _doubles(self, values: Array) -> Any:
        return self._ffi.from_buffer("double[]", np.ascontiguousarray(values, float))

    def _steps(self, theta: Array, period: float) -> tuple[tuple[int, int], float]:
        """Steps of a sampling period in fast and in slow motion, and the speed between the two."""
        law = self.candidate
        if not law.has_bristles:
            steps = NEURAL_STEPS if law.name == "neural" else 1
            return (steps, steps), 0.0
        J, (s0, _, excess, coulomb, *_) = theta[0], law.law_values(theta)
        angle = period * float(np.sqrt(s0 / J))
        steps = int(np.clip(np.ceil(angle / RESOLVED), *LUGRE_STEPS))
        # at most this speed the joint can come to rest within a period, or ring on its bristles
        slow = abs(excess + coulomb) * (period / J + RINGING_SPEED / float(np.sqrt(s0 * J)))
        return (LUGRE_STEPS[0], steps), float(slow)


@lru_cache(maxsize=16)
def joint_simulation(candidate: Candidate, slides: bool) -> JointSimulation:
    """The :class:`JointSimulation` of ``candidate``, built once in a process."""
    return JointSimulation(candidate, slides)


# ------------------------------------------------------------------------------------------------------------------
# One step of the motion as a program: the state x after h seconds under the torque u.
# ------------------------------------------------------------------------------------------------------------------


def joint_step(candidate: Candidate, slides: bool) -> Program:
    """The program ``step(x, u, theta, setting) -> after`` of the joint that ``candidate`` describes.

    ``x`` is position, speed and, for a law with a state, deflection of the bristles; ``theta`` (k - 1,) are the
    parameters without the delay, and ``setting`` the length of the step (s) and the direction of sliding.
    """
    builder = Builder()
    n = 3 if candidate.has_bristles else 2
    x = builder.input(Port("x", (n,), "mixed", "", "position, speed, deflection of bristles"))
    u = builder.input(Port("u", (1,), "N m | N", "joint", "torque", Role.TORQUE))
    theta = builder.input(Port("theta", (len(candidate.names) - 1,), "mixed", "", "parameters without the delay"))
    h, direction = builder.input(Port("setting", (2,), "mixed", "", "length of the step, direction of sliding"))
    joint = _Joint(builder, candidate, [*theta, 0])
    if candidate.has_bristles:
        after = _on_bristles(joint, x, u[0], h)
    elif not candidate.jumps:
        after = _smooth(joint, x, u[0], h)
    else:
        after = _sliding(joint, x, u[0], h, direction) if slides else _sticking(joint, x, u[0], h)
    port = Port("after", (n,), "mixed", "", "state after the step")
    return builder.program("step", [(port, after)], summary="A step of the motion of one joint.")


@dataclass(frozen=True)
class _Joint:
    """Inertia, gravity and friction of a joint, recorded in a ``builder`` for the parameters ``theta`` (k,)."""

    builder: Builder
    candidate: Candidate
    theta: Sequence[Any]

    @property
    def J(self) -> Any:
        return self.theta[0]

    def net(self, u: Any, q: Any) -> Any:
        """The torque ``u`` less gravity at the position ``q``."""
        return u - self.candidate.gravity_torque(q, self.theta, self.builder)

    def friction(self, v: Any, direction: Any) -> Any:
        """Friction at the speed ``v`` in the given direction of sliding."""
        return self.candidate.law.torque(Directed(self.builder, direction), v, self.candidate.law_values(self.theta))


def _sliding(joint: _Joint, x: Sequence[Any], u: Any, h: Any, direction: Any) -> list[Any]:
    """The midpoint rule, for a law that jumps at zero speed, in a given direction of sliding."""
    q, v = x
    net = joint.net(u, q + HALF * h * v)
    a = (net - joint.friction(v, direction)) / joint.J
    a = (net - joint.friction(v + HALF * h * a, direction)) / joint.J
    return [q + h * (v + HALF * h * a), v + h * a]


def _sticking(joint: _Joint, x: Sequence[Any], u: Any, h: Any) -> list[Any]:
    """The midpoint rule with a constant direction of sliding, cut at the time at which the joint stops."""
    b, (q, v) = joint.builder, x
    forward, backward = (joint.friction(Fraction(0), Fraction(d)) for d in (1, -1))
    net = joint.net(u, q + HALF * h * v)
    starting = b.select(net - forward, 1, b.select(backward - net, -1, 0))
    direction = b.select(b.abs(v), b.sign(v), starting)
    sliding = b.abs(direction)
    a = (net - joint.friction(v, direction)) * sliding / joint.J
    a = (net - joint.friction(v + HALF * h * a, direction)) * sliding / joint.J
    after = v + h * a
    stops = -(after * direction)
    share = v / (v - after)
    rest = (1 - share) * h
    level = b.select(starting, forward, backward)
    again = b.select(b.abs(starting), (net - level) / joint.J * rest, 0)
    return [
        b.select(stops, q + HALF * share * h * v + HALF * again * rest, q + HALF * h * (v + after)),
        b.select(stops, again, after),
    ]


def _smooth(joint: _Joint, x: Sequence[Any], u: Any, h: Any) -> list[Any]:
    """The trapezoidal rule, linearised in the speed: stable for friction that is steep at low speed."""
    b, (q, v) = joint.builder, x
    net = joint.net(u, q + HALF * h * v)
    law = Builder()
    speed = law.input(Port("v", (1,)))
    values = law.input(Port("values", (len(joint.theta),)))
    torque = joint.candidate.law.torque(law, speed[0], joint.candidate.law_values(values))
    program = jacobian(law.program("friction", [(Port("f", (1,)), [torque])]), "f", ("v",))
    (friction,), (slope,) = replay(program, b, [[v], joint.theta])
    stiff = joint.J / h
    # 2 J dv/h + slope dv = 2 (net - friction)
    dv = (net - friction) / (stiff - HALF * b.min(-slope, stiff))
    return [q + h * (v + HALF * dv), v + dv]


def _on_bristles(joint: _Joint, x: Sequence[Any], u: Any, h: Any) -> list[Any]:
    """Solve ``dz/dt = v - y z/h`` with the mean speed, ``y = h |v| / reach(v)``, and ``J dv = h (u - tau_f)``.

    At a step's mean speed the deflection and its mean over the step are exact; the mean of the deflections at both ends
    in place of the exact one would spoil stiffness and damping, since bristles that bend back from break-away to
    sliding do so in less than a step. After a step of length h ``z+ = e^-y z + h p v``, the mean deflection is
    ``p z + h r v`` with ``p = (1 - e^-y)/y`` and ``r = (1 - p)/y``. The mean speed follows from them, and they from it:
    by iteration.
    """
    b, (q, v, z) = joint.builder, x
    law = joint.candidate.law
    values = joint.candidate.law_values(joint.theta)
    given = dict(zip((parameter.name for parameter in law.parameters), values, strict=True))
    s0, viscous = given["sigma0"], given["viscous"]
    assert law.bristles is not None
    inertia = joint.J / h
    driving = joint.net(u, q + HALF * h * v) + (inertia - HALF * viscous) * v
    mean: Any = v
    for _ in range(MEAN_SPEEDS):
        reach, s1 = law.bristles(b, mean, values)
        y: Any = -b.min(-(h * b.abs(mean) / reach), -SMALLEST)
        t = b.tanh(HALF * y)
        forgotten = 2 * t / (1 + t)
        p = forgotten / y
        gain = HALF * h * p
        resistance = HALF * h * s0 * (1 - p) / y + s1 * p / 2
        after = driving - s0 * z * p - resistance * v + s1 / h * z * forgotten
        after = after / (inertia + HALF * viscous + resistance)
        mean = HALF * (v + after)
    return [q + h * mean, after, z + gain * (v + after) - forgotten * z]
