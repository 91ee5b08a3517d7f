"""Recorders of desired motions from point to point: a quintic polynomial, and a trapezoidal speed in phase."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from rrrgen.derive.functions.dynamics import inverse_dynamics, link_frames_only, torque_port
from rrrgen.derive.functions.recording import FunctionBuilder
from rrrgen.program import Builder, Port, Program, Role, Value
from rrrgen.program.builder import replay

MOTION = ("q_d", "dq_d", "ddq_d")


def _outputs(r: FunctionBuilder) -> list[Port]:
    """Make the output ports q_d, dq_d and ddq_d (n,): the desired motion at one point in time."""
    units = [" | ".join(part + per for part in r.position_unit.split(" | ")) for per in ("", "/s", "/s^2")]
    meanings = ("desired positions", "desired velocities", "desired accelerations")
    return [Port(name, (r.n,), unit, "", meaning) for name, unit, meaning in zip(MOTION, units, meanings, strict=True)]


def quintic(r: FunctionBuilder) -> Program:
    """Record the motion q_d, dq_d, ddq_d (n,) at time t along the quintic polynomial between two states."""
    b, half = r.builder, Fraction(1, 2)
    (t,) = r.take("t")
    (T,) = r.take("T")
    ends = {name: r.take(name) for name in ("q_0", "dq_0", "ddq_0", "q_1", "dq_1", "ddq_1")}
    x = _clamp(b, b.div(t, T))
    motion: tuple[list[Value], list[Value], list[Value]] = ([], [], [])
    for i in range(r.n):
        q0, q1 = ends["q_0"][i], ends["q_1"][i]
        v0, v1 = b.mul(T, ends["dq_0"][i]), b.mul(T, ends["dq_1"][i])
        a0, a1 = (b.mul(b.mul(T, T), ends[name][i]) for name in ("ddq_0", "ddq_1"))
        c2: Any = half * a0
        way: Any = b.sub(q1, q0)
        c3: Any = 10 * way - 6 * v0 - 4 * v1 - Fraction(3, 2) * a0 + half * a1
        c4: Any = -15 * way + 8 * v0 + 7 * v1 + Fraction(3, 2) * a0 - a1
        c5: Any = 6 * way - 3 * (v0 + v1) - half * a0 + half * a1
        motion[0].append(q0 + x * (v0 + x * (c2 + x * (c3 + x * (c4 + x * c5)))))
        motion[1].append((v0 + x * (2 * c2 + x * (3 * c3 + x * (4 * c4 + x * (5 * c5))))) / T)
        motion[2].append((2 * c2 + x * (6 * c3 + x * (12 * c4 + x * (20 * c5)))) / (T * T))
    return b.program(
        "quintic",
        list(zip(_outputs(r), motion, strict=True)),
        "Quintic motion between two states, for one instant.",
        "q_d = sum over k of c_k (t/T)^k, k = 0..5",
        ["Before 0 and after T the motion is that of the nearer end."],
    )


def _clamp(b: Builder, x: Value) -> Value:
    """Record ``x`` limited to the range from 0 to 1."""
    return b.select(b.sub(x, 1), 1, b.select(x, x, 0))


def trapezoidal(r: FunctionBuilder) -> Program:
    """Record the fastest straight motion in joint space with trapezoidal speed, with all joints in phase.

    Outputs are q_d, dq_d, ddq_d (n,) at time t; no joint exceeds its largest speed and acceleration.
    """
    b = r.builder
    (t,) = r.take("t")
    q0 = r.take("q_0")
    q1 = r.take("q_1")
    dq_max = r.take("dq_max")
    ddq_max = r.take("ddq_max")
    way = [b.sub(y, x) for x, y in zip(q0, q1, strict=True)]
    # the phase s runs from 0 to 1 with s' <= 1/W and s'' <= 1/B; its highest speed is 1/D
    W = _largest(b, [b.div(b.abs(d), v) for d, v in zip(way, dq_max, strict=True)])
    B = _largest(b, [b.div(b.abs(d), a) for d, a in zip(way, ddq_max, strict=True)])
    D = _largest(b, [W, b.sqrt(B)])
    moving = b.select(D, D, 1)
    ramp = b.div(B, moving)
    T: Any = b.add(D, ramp)
    slope = b.div(1, b.select(B, B, 1))
    now = b.select(b.sub(t, T), T, b.select(t, t, 0))
    left = b.sub(T, now)
    rising, falling = b.sub(ramp, now), b.sub(ramp, left)
    half = Fraction(1, 2)
    up: list[Any] = [half * (slope * (now * now)), slope * now, slope]
    down: list[Any] = [1 - half * (slope * (left * left)), slope * left, -slope]
    even: list[Any] = [(now - half * ramp) / moving, 1 / moving, 0]
    inside = b.select(b.sub(t, T), 0, b.select(t, 1, 0))
    phase = [b.select(rising, x, b.select(falling, y, z)) for x, y, z in zip(up, down, even, strict=True)]
    phase = [phase[0], b.mul(inside, phase[1]), b.mul(inside, phase[2])]
    done = b.select(D, 0, 1)
    phase[0] = b.select(done, 1, b.select(b.sub(t, T), 1, phase[0]))
    motion = [[b.mul(part, d) for d in way] for part in phase]
    motion[0] = [b.add(x, moved) for x, moved in zip(q0, motion[0], strict=True)]
    return b.program(
        "trapezoidal",
        [*zip(_outputs(r), motion, strict=True), (Port("T", (), "s", "", "duration of the motion"), [T])],
        "Straight motion in joint space with trapezoidal speed and all joints in phase, for one instant.",
        "q_d = q_0 + s(t) (q_1 - q_0),  |dq_d| <= dq_max,  |ddq_d| <= ddq_max",
        ["Before 0 the motion rests at q_0, after T at q_1."],
    )


def _largest(b: Builder, values: list[Value]) -> Value:
    """The largest of ``values``."""
    largest = values[0]
    for value in values[1:]:
        largest = b.select(b.sub(value, largest), value, largest)
    return largest


# ------------------------------------------------------------------------------------------------------------------
# Recorder of the dynamics along a geometric path q(s), linear in d2s/dt2 and (ds/dt)^2.
#
# With u = d2s/dt2, x = (ds/dt)^2 and primes for derivatives by s, ``dq = q' ds/dt`` and ``ddq = q' u + q'' x``. The
# velocity torques c(q, dq) are quadratic in dq, so that along the path
#
#     tau = (M q') u + (M q'' + c(q, q')) x + g.
# ------------------------------------------------------------------------------------------------------------------


def path_dynamics(r: FunctionBuilder) -> Program:
    """Record the joint torques along a path q(s), which are linear in u = d2s/dt2 and x = (ds/dt)^2.

    ``tau = a u + b x + g`` with a = M q', b = M q'' + c(q, q') and g, (n,) each; q' and q'' are derivatives by s.
    """
    r.joints("q")
    slope = r.take("q_s")
    curve = r.take("q_ss")
    program = inverse_dynamics(link_frames_only)(r.with_gravity_input())
    gravity = r.gravity() if r.model.spec.gravity_input else [r.constant(g) for g in r.model.spec.gravity]
    rest, weightless = [0] * r.n, [0, 0, 0]

    def torques(dq: Sequence[Value], ddq: Sequence[Value], g: Sequence[Value]) -> list[Value]:
        known = {Role.VELOCITY: dq, Role.ACCELERATION: ddq, Role.GRAVITY: g, Role.BASE_PARAMETERS: r.beta()}
        return replay(program, r.builder, r.inputs_of(program, known))[0]

    ports = [
        (torque_port(r, "a", "M q', the factor of u"), torques(rest, slope, weightless)),
        (torque_port(r, "b", "M q'' + c(q, q'), the factor of x"), torques(slope, curve, weightless)),
        (torque_port(r, "g", "torques that hold the arm against gravity"), torques(rest, rest, gravity)),
    ]
    return r.builder.program(
        "path_dynamics",
        ports,
        "Joint torques along a path q(s), linear in u = d2s/dt2 and x = (ds/dt)^2.",
        "M ddq + c(q, dq) + g(q) = a u + b x + g,  dq = q_s ds/dt,  ddq = q_s u + q_ss x",
        ["The unit of s is free."],
    )
