"""Default gains of the controller from the inertia of the arm at one configuration: proposals, not a tuning."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from mpmath import diag, eigsy, matrix

from rrrgen.controller.table import ControllerUnit
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.program.evaluation import evaluate_floats
from rrrgen.program.program import Program

STIFF, SOFT = 20.0, 8.0
"""Bandwidths of tracking and of impedances, rad/s: far below what a period of 1 ms allows."""

SPEED_POLE = 250.0
"""Pole of the filters of the speeds, 1/s; the loops are ten times slower."""

MIDDLE = 0.6
"""Share of the way between the limits: off the singular configurations at the middle of many arms."""

SAMPLED = 0.5
"""Bound of the sum of the eigenvalues of ``Ts M^-1 D``; sampled damping is unstable from 2 on."""

LEARNING = 0.01
"""Share of the error of the torques that the estimator takes out in one period of a fast motion."""

DIGITS = 2
"""Significant digits of proposals, so that they do not depend on the rounding of the machine that makes them."""

JUMP = 4.0
"""Steps of the position above this many times the largest speed times the period are no motion."""


def proposals(unit: ControllerUnit) -> dict[str, tuple[float, ...]]:
    """Defaults of gains and parameters by the name of the field; zero is left out. Those that are given stay.

    With the diagonal of the mass matrix at the middle of the joint limits, ``kd = 2 w M_ii`` and ``kp = w^2 M_ii``; for
    the tip, the inertia that it has along and about each axis of the base. Dampings of joints are less where one period
    would be too long for them (:func:`_damping`), and ``kp = kd^2/(4 M_ii)`` follows.
    """
    model, spec, n = unit.model, unit.model.spec, unit.n
    inertia, free, tip = _inertias(model)

    def damping(pole: float) -> list[float]:
        return _damping(pole, inertia, free, unit.period)

    def springs(pole: float) -> tuple[float, ...]:
        return _scale_and_round(
            [d * d / m if m > 0.0 else 0.0 for d, m in zip(damping(pole), inertia, strict=True)], 0.25
        )

    defaults: dict[str, tuple[float, ...]] = {
        "stop_damping": _scale_and_round(damping(2.0 * STIFF)),
        "guide_damping": _scale_and_round(damping(0.5)),
        "pd_kp": springs(2.0 * STIFF),
        "pd_kd": _scale_and_round(damping(2.0 * STIFF)),
        "joint_stiffness": springs(2.0 * SOFT),
        "joint_damping": _scale_and_round(damping(2.0 * SOFT)),
        "stiffness": _scale_and_round(tip, SOFT**2),
        "damping": _scale_and_round(tip, 2.0 * SOFT),
        "null_damping": _scale_and_round(damping(SOFT)),
        "k": _scale_and_round(damping(STIFF)),
        "kp": (STIFF**2,), "kd": (2.0 * STIFF,),
        "tip_kp": (STIFF**2,), "tip_kd": (2.0 * STIFF,), "tip_damping": (0.02,),
        "lam": (STIFF / 2.0,),
        "ik_weight": (1.0,) * 3 + ((1.0,) * 3 if n >= 6 else (0.0,) * 3),
        "speed_pole": (SPEED_POLE,),
        "kalman_gain": _kalman_gain(unit.period) * n,
    }  # fmt: skip
    speeds = [joint.limits.velocity for joint in spec.joints]
    defaults["q_jump"] = tuple(math.inf if v is None else _round(JUMP * float(v) * unit.period) for v in speeds)
    beta = [float(value) for value in (*(model.beta_nominal or (0,) * model.b), *(model.drive_inertia_nominal or ()))]
    drives = len(model.drive_inertia_nominal or ())
    defaults["beta"] = tuple(beta)
    links = beta[: model.b]
    defaults["gamma"] = (*(_round(0.1 * value * value) for value in links), *(0.0,) * drives)
    defaults["beta_min"] = (*(_round(value - abs(value)) for value in links), *(-math.inf,) * drives)
    defaults["beta_max"] = (*(_round(value + abs(value)) for value in links), *(math.inf,) * drives)
    defaults["friction"] = tuple(float(value) for _, value in friction_parameters(spec))
    if unit.has("estimator"):
        defaults["estimator_gain"] = _estimator_gain(model, beta)
    return {**defaults, **unit.given}


def _kalman_gain(period: float) -> tuple[float, ...]:
    """Gains of position, speed and acceleration that give the filter three equal poles (the fading-memory filter)."""
    pole = math.exp(-SPEED_POLE * period)
    gain = (
        1.0 - pole**3,
        1.5 * (1.0 - pole) ** 2 * (1.0 + pole) / period,
        (1.0 - pole) ** 3 / period**2,
    )
    return tuple(_round(value, 4) for value in gain)


def _estimator_gain(model: DerivedModel, beta: list[float]) -> tuple[float, ...]:
    """Gains in proportion to the square of each parameter; a sample of a fast motion takes a share of LEARNING."""
    q = [_middle(joint.limits.lower, joint.limits.upper) for joint in model.spec.joints]
    motion = {"q": q, "dq": [1.0] * len(q), "ddq": [1.0] * len(q), "gravity": [0.0, 0.0, -9.81]}
    Y = _output_matrix(model.programs["regressor"], motion)
    Y *= diag(beta[: Y.cols])
    largest = max(eigsy(Y * Y.T, eigvals_only=True))  # square of the largest singular value
    share = LEARNING / float(largest) if largest > 0.0 else 0.0
    return tuple(_round(share * value * value) for value in beta)


def _damping(pole: float, inertia: list[float], free: list[float], period: float) -> list[float]:
    """Dampings D of joints, ``pole`` times their inertia, or less so that the sampled loop is stable.

    Torques -D dq held for a period Ts leave ``(I - Ts M^-1 D) dq``, unstable as soon as an eigenvalue of ``Ts M^-1 D``
    exceeds 2. Their sum is ``Ts sum_i D_i (M^-1)_ii``; each joint may take an equal part of SAMPLED of it. On a
    light arm with seven joints ``1/(M^-1)_ii``, the inertia of a joint whose neighbours yield, is 30 times less than
    ``M_ii``.
    """
    part = SAMPLED / len(inertia) / period
    return [min(pole * whole, part * yielding) for whole, yielding in zip(inertia, free, strict=True)]


def _inertias(model: DerivedModel) -> tuple[list[float], list[float], list[float]]:
    """The inertia of each joint M_ii (n,), and ``1/(M^-1)_ii`` (n,), the least of three configurations; that of the
    tip (6,). Ones where the robot file states no links."""
    n = model.spec.n
    if model.beta_nominal is None:
        return [1.0] * n, [1.0] * n, [1.0] * 6
    beta = [float(value) for value in (*model.beta_nominal, *(model.drive_inertia_nominal or ()))]
    limits = [joint.limits for joint in model.spec.joints]

    def evaluate(function: str, shares: Sequence[float]) -> matrix:
        q = [_middle(limit.lower, limit.upper, shares[k % len(shares)]) for k, limit in enumerate(limits)]
        return _output_matrix(model.programs[function], {"q": q, "beta": beta})

    masses = [evaluate("mass_matrix", shares) for shares in ((MIDDLE,), (0.5,), (0.3, 0.7, 0.8))]
    inverses = [_pseudo_inverse(M) for M in masses]
    free = [1.0 / max(float(inverse[i, i]) for inverse in inverses) for i in range(n)]
    J = evaluate("jacobian", (MIDDLE,))
    mobility = _diagonal(J * inverses[0] * J.T)
    tip = [1.0 / entry if entry > 1e-6 * max(mobility) else 0.0 for entry in mobility]
    return _diagonal(masses[0]), free, tip


def _output_matrix(program: Program, values: Mapping[str, Sequence[float]]) -> matrix:
    """The first output of ``program`` as a matrix, from its inputs by name."""
    rows, columns = program.outputs[0].shape
    numbers = evaluate_floats(program, *(values[port.name] for port in program.inputs))[0]
    return matrix([numbers[columns * i : columns * (i + 1)] for i in range(rows)])


def _pseudo_inverse(symmetric: matrix) -> matrix:
    """The pseudo-inverse of a positive semidefinite matrix; eigenvalues of joints that move no mass count as zero."""
    values, vectors = eigsy(symmetric)
    least = 1e-15 * max(values)
    return vectors * diag([1.0 / value if value > least else 0.0 for value in values]) * vectors.T


def _diagonal(square: matrix) -> list[float]:
    return [float(square[i, i]) for i in range(square.rows)]


def _middle(lower: Any, upper: Any, share: float = MIDDLE) -> float:
    """A position at a share of the way between the limits."""
    if lower is None or upper is None:
        return share - 0.1
    return float(lower) + share * (float(upper) - float(lower))


def _scale_and_round(values: list[float], factor: float = 1.0) -> tuple[float, ...]:
    return tuple(_round(factor * value) for value in values)


def _round(value: float, digits: int = DIGITS) -> float:
    return float(f"{value:.{digits}g}")
