"""Recorder of the dynamics along a geometric path q(s), linear in d2s/dt2 and (ds/dt)^2.

With u = d2s/dt2, x = (ds/dt)^2 and primes for derivatives by s, ``dq = q' ds/dt`` and ``ddq = q' u + q'' x``. The
velocity torques c(q, dq) are quadratic in dq, so that along the path

    tau = (M q') u + (M q'' + c(q, q')) x + g.
"""

from __future__ import annotations

from collections.abc import Sequence

from rrrgen.derive.functions.dynamic_functions import inverse_dynamics, link_frames_only, torque_port
from rrrgen.derive.functions.recording import Recording
from rrrgen.program import Program, Role, Value
from rrrgen.program.builder import replay


def path_dynamics(r: Recording) -> Program:
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
