"""Recorders of contact detection from estimated external torques r: thresholds, and the wrench at a point.

A contact changes r faster than errors of the model do. Besides r itself, its change h is therefore compared with
thresholds: the estimate of an observer with twice the pole minus r, which needs nothing but r, since with
alpha = exp(-gain Ts)

    h = alpha^2 h_last + alpha (r - r_last).

It is a band-pass: after a step of the external torque h rises to a quarter of the step and decays.

The joint torques of a wrench F at a point with Jacobian J are ``r = J' F``. With errors of r of covariance S, the best
estimate and its covariance are

    F = P J inv(S) r,   P = inv(J inv(S) J').
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from rrrgen.derive.functions.friction import RunTimeFriction
from rrrgen.derive.functions.recording import FunctionBuilder, Recorder
from rrrgen.derive.recursions import energy_and_momentum as momentum
from rrrgen.derive.recursions import mass_matrix_and_gravity as composite
from rrrgen.derive.recursions.linear_algebra import Matrix, add, dot, factorize, flat, subtract, times
from rrrgen.program import Port, Program, Status

TINY = Fraction(1, 10**20)
"""Added to thresholds (N m), so that the ratio is finite for a threshold of zero."""


def contact(r: FunctionBuilder) -> Program:
    """Record one tick of contact detection by the external torques r and their changes h.

    Outputs are the ratios max(|r_i|/threshold_i, |h_i|/change_threshold_i) (n,), 1 if one of them exceeds 1, and the
    changes h (n,), which are state for the next tick.
    """
    b = r.builder
    estimate = r.take("r")
    last = r.take("r_last")
    change_last = r.take("change_last")
    (gain,) = r.take("gain")
    (Ts,) = r.take("Ts")
    threshold = r.take("threshold")
    change_threshold = r.take("change_threshold")
    alpha = b.exp(b.neg(b.mul(gain, Ts)))
    change = [
        b.mul(alpha, b.add(b.mul(alpha, before), b.sub(now, then)))
        for now, then, before in zip(estimate, last, change_last, strict=True)
    ]
    pairs = [
        [b.div(b.abs(value), b.add(limit, TINY)) for value, limit in zip(values, limits, strict=True)]
        for values, limits in ((estimate, threshold), (change, change_threshold))
    ]
    ratios = [b.select(b.sub(fast, slow), fast, slow) for slow, fast in zip(*pairs, strict=True)]
    touches: Any = 0
    for ratio in ratios:
        touches = b.select(b.sub(ratio, 1), 1, touches)
    return b.program(
        "contact",
        [
            (Port("ratio", (r.n,), "1", "", "of each joint: torque or change over its threshold, the larger"), ratios),
            (Port("touches", (), "1", "", "1 if a ratio exceeds 1, else 0", refused=1), [touches]),
            (
                Port("change", (r.n,), r.torque_unit, "", "fast part of r, for the next tick", state="change_last"),
                change,
            ),
        ],
        "Contact detection: whether an external torque, or its change, exceeds its threshold.",
        "change = alpha^2 change_last + alpha (r - r_last),  ratio = max(|r|/threshold, |change|/change_threshold),  "
        "alpha = exp(-gain Ts)",
        [
            "INFINITY leaves a joint out. A threshold of zero makes any torque a contact.",
            "Refused input is not taken for an arm without contact: touches is 1.",
        ],
    )


@dataclass(frozen=True)
class _Load:
    """The kind of load to estimate: a wrench (6 rows of the Jacobian) or a pure force (the first 3 rows).

    ``name`` is that of the function, ``words`` and ``unit`` describe its result in emitted files, ``covariance`` is the
    unit of its covariance.
    """

    rows: int
    name: str
    words: str
    unit: str
    covariance: str


WRENCH = _Load(6, "external_wrench", "force and moment", "N, N m", "N^2, N^2 m, (N m)^2")
FORCE = _Load(3, "external_force", "force without a moment", "N", "N^2")


def external_load(load: _Load) -> Recorder:
    """Make a recorder of the wrench or force at a point that causes the external torques r.

    The function's outputs are the estimate, its covariance and its condition number.
    """

    def record(r: FunctionBuilder) -> Program:
        b, count = r.builder, load.rows
        J = r.take("J")
        estimate = r.take("r")
        S = r.take("covariance")
        errors = factorize(b, [S[r.n * i : r.n * (i + 1)] for i in range(r.n)])  # S = L D L'
        halves = [errors.forward(J[r.n * i : r.n * (i + 1)]) for i in range(count)]  # the rows of J, by inv(L)
        weighted = [[b.mul(x, d) for x, d in zip(row, errors.reciprocals, strict=True)] for row in halves]
        G = [[dot(x, y) for y in halves] for x in weighted]
        G[0][0] = b.select(errors.status, 0, G[0][0])  # no covariance: nothing is determined
        factors = factorize(b, G)
        P = [[b.neg(value) for value in row] for row in factors.negative_inverse()]
        F = times(P, times(weighted, errors.forward(estimate)))
        return b.program(
            load.name,
            [
                (Port("F", (count,), load.unit, "base frame", f"{load.words} on the arm"), F),
                (Port("P", (count, count), load.covariance, "base frame", "its covariance"), flat(P)),
                (
                    Port("condition", (), "1", "", "at least 1; large near singular configurations"),
                    [_condition(r, G, P)],
                ),
                (Port("status", (), "1"), [factors.status]),
            ],
            f"The {load.words} that estimated external torques are due to.",
            "F = P J inv(S) r,  P = inv(J inv(S) J'),  S = covariance",
            [
                f"J: its first {count} rows. F, P and condition are 0 where the status is not ok.",
                "condition = sqrt(mean eigenvalue of J inv(S) J' times that of P), linear and angular rows scaled to "
                f"one mean first; the largest over the smallest singular value is between this and {count} times this.",
            ],
            Status.of(
                3, "undetermined", "the torques do not determine the load", "the Jacobian or the covariance loses rank"
            ),
        )

    return record


def _condition(r: FunctionBuilder, G: Matrix, P: Matrix) -> Any:
    """Condition number of G, from G and its inverse P, after scaling.

    The linear and the angular rows and columns are each scaled so that the mean of their diagonal entries is one.
    """
    total: Any = 0
    count = len(G)
    for part in range(0, count, 3):
        ends = range(part, part + 3)
        total = total + dot([1] * 3, [G[k][k] for k in ends]) / 3 * dot([1] * 3, [P[k][k] for k in ends])
    return r.builder.sqrt(total / count)


EXTERNAL_WRENCH, EXTERNAL_FORCE = external_load(WRENCH), external_load(FORCE)


# ------------------------------------------------------------------------------------------------------------------
# Recorder of the momentum observer: the torques that the environment exerts, without acceleration or a model inverse.
#
# With p = M dq and ``u = C' dq - g - f``, dp/dt = tau + u + tau_ext. One step per tick of the incremental form
#
#     y = (p - p_last)/Ts - tau - (u + u_last)/2,   r = alpha r_last + (1 - alpha) y,   alpha = exp(-gain Ts),
#
# gives the estimate r of tau_ext, which follows it as a first-order lag with the pole ``gain``. It does not drift, is
# stable for every gain and period, and needs no integral of the momentum; tau is the torque *applied* since the last
# tick.
# ------------------------------------------------------------------------------------------------------------------

STATE = (
    ("p", "p_last", "generalized momentum", "N m s | N s"),
    ("u", "u_last", "torques of motion, gravity and friction", "N m | N"),
)


def _momentum_and_torques(r: FunctionBuilder, further: tuple[str, ...] = ()) -> tuple[list[Any], list[Any]]:
    """Record what the momentum observer knows of the present state, ``p = M dq`` and ``u = C' dq - g - f(dq)``, (n,).

    p is the generalized momentum, N m s or N s; without contact ``dp/dt = tau + u`` with the torques tau of the drives
    and friction f. Declares the inputs q, dq and ``further`` joint vectors, parameters and friction.
    """
    chain = r.chain_in_gravity("dq", *further)
    dq = r.joints("dq")
    for name in further:
        r.joints(name)
    inertias, drives = r.inertias(), r.drive_inertia()
    p, transposed = momentum.momentum_and_coriolis_transpose(chain, dq, inertias)
    laws = RunTimeFriction.declare(r, smooth=True)
    friction = laws.torques(dq, composite.gravity(chain, inertias) if laws.has_load else ())
    u = subtract(subtract(transposed, composite.gravity(chain, inertias)), friction)
    return drives.added_to_momentum(p, dq), u


def _ports(r: FunctionBuilder, following: str) -> list[Port]:
    return [
        Port(name, (r.n,), r.unit(unit), "", f"{meaning}{following}", state=last) for name, last, meaning, unit in STATE
    ]


def momentum_observer_start(r: FunctionBuilder) -> Program:
    """Record the state p, u (n,) of the momentum observer at its first tick."""
    values = _momentum_and_torques(r)
    return r.builder.program(
        "momentum_observer_start",
        list(zip(_ports(r, ", for the next tick"), values, strict=True)),
        "State of the momentum observer at its first tick; r is zero then.",
        "p = M dq,  u = C' dq - g - f(dq)",
    )


def momentum_observer(r: FunctionBuilder) -> Program:
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
