"""Recorder of the momentum observer: the torques that the environment exerts, without acceleration or a model inverse.

With p = M dq and ``u = C' dq - g - f``, dp/dt = tau + u + tau_ext. One step per tick of the incremental form

    y = (p - p_last)/Ts - tau - (u + u_last)/2,   r = alpha r_last + (1 - alpha) y,   alpha = exp(-gain Ts),

gives the estimate r of tau_ext, which follows it as a first-order lag with the pole ``gain``. It does not drift, is
stable for every gain and period, and needs no integral of the momentum; tau is the torque *applied* since the last
tick.
"""

from __future__ import annotations

from typing import Any

from rrrgen.derive.functions.friction import RunTimeFriction
from rrrgen.derive.functions.recording import Recording
from rrrgen.derive.recursions import energy_and_momentum as momentum
from rrrgen.derive.recursions import mass_matrix_and_gravity as composite
from rrrgen.derive.recursions.vectors import add, subtract
from rrrgen.program import Port, Program

STATE = (
    ("p", "p_last", "generalized momentum", "N m s | N s"),
    ("u", "u_last", "torques of motion, gravity and friction", "N m | N"),
)


def _momentum_and_torques(r: Recording, further: tuple[str, ...] = ()) -> tuple[list[Any], list[Any]]:
    """Record p (n,) and u (n,) of the module's docstring at the present state, whose inputs are declared."""
    chain = r.chain_in_gravity("dq", *further)
    dq = r.joints("dq")
    for name in further:
        r.joints(name)
    inertias, drives = r.inertias(), r.drive_inertia()
    p, transposed = momentum.momentum_and_coriolis_transpose(chain, dq, inertias)
    laws = RunTimeFriction.declared(r, smooth=True)
    friction = laws.torques(dq, composite.gravity(chain, inertias) if laws.has_load else ())
    u = subtract(subtract(transposed, composite.gravity(chain, inertias)), friction)
    return drives.added_to_momentum(p, dq), u


def _ports(r: Recording, following: str) -> list[Port]:
    return [
        Port(name, (r.n,), r.unit(unit), "", f"{meaning}{following}", state=last) for name, last, meaning, unit in STATE
    ]


def momentum_observer_start(r: Recording) -> Program:
    """Record the state p, u (n,) of the momentum observer at its first tick."""
    values = _momentum_and_torques(r)
    return r.builder.program(
        "momentum_observer_start",
        list(zip(_ports(r, ", for the next tick"), values, strict=True)),
        "State of the momentum observer at its first tick; r is zero then.",
        "p = M dq,  u = C' dq - g - f(dq)",
    )


def momentum_observer(r: Recording) -> Program:
    """Record one tick of the momentum observer: the external torques r (n,), and the state for the next tick."""
    p, u = _momentum_and_torques(r, ("tau",))
    tau = r.joints("tau")
    p_last, u_last = (r.take(last) for _, last, _, _ in STATE)
    r_last = r.take("r_last")
    (gain,) = r.take("gain")
    (Ts,) = r.take("Ts")
    b = r.builder
    alpha = b.exp(b.neg(b.mul(gain, Ts)))
    rate = [b.div(change, Ts) for change in subtract(p, p_last)]
    half = [b.div(value, 2) for value in add(u, u_last)]
    y = subtract(subtract(rate, tau), half)
    estimate = [b.add(now, b.mul(alpha, b.sub(before, now))) for now, before in zip(y, r_last, strict=True)]
    port = Port("r", (r.n,), r.torque_unit, "", "estimated torques of the environment", state="r_last")
    return b.program(
        "momentum_observer",
        [(port, estimate), *zip(_ports(r, ", for the next tick"), (p, u), strict=True)],
        "One tick of the momentum observer, which estimates the torques of the environment.",
        "r = alpha r_last + (1 - alpha) ((p - p_last)/Ts - tau - (u + u_last)/2),  alpha = exp(-gain Ts)",
        [
            "tau are the torques applied since the last tick, r, p and u the state for the next one.",
            "Noise of the speeds: the standard deviation of r grows with gain and M; take a filtered dq.",
        ],
    )
