"""The friction laws of one joint, (14.11)-(14.14) and others of the literature, each written once for every arithmetic.

``ops`` supplies sgn, exp and tanh as ``ops.sign``, ``ops.exp``, ``ops.tanh``: a program builder, NumPy, or CasADi.
Speeds ``dq`` are in rad/s (m/s), torques in N m (N), with sgn(0) = 0. No law uses |dq| other than as ``dq sgn(dq)``, so
that replacing sgn by tanh(./eps) alone makes all of them smooth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple


class LawParameter(NamedTuple):
    """One coefficient of a law: its name, its unit for a revolute joint, what it is."""

    name: str
    unit: str
    meaning: str
    positive: bool = False


@dataclass(frozen=True)
class FrictionLaw:
    """A friction law of one joint.

    ``torque(ops, dq, p)`` is the law (in sliding, where it has a state); ``columns(ops, dq)`` are the factors of the
    parameters where the law is linear in them. A law with a ``rate`` has one state z per joint:
    ``dz/dt = rate(ops, z, dq, p)``, ``tau = state_torque(ops, z, dq, p)``, and ``step(ops, z, dq, p, period)`` gives z
    and the torque after a period. ``passivity(p)`` is a margin that is not negative where the law is surely passive.
    """

    name: str
    equation: str
    formula: str
    parameters: tuple[LawParameter, ...]
    torque: Callable[[Any, Any, Sequence[Any]], Any]
    columns: Callable[[Any, Any], list[Any]] | None = None
    rate: Callable[[Any, Any, Any, Sequence[Any]], Any] | None = None
    state_torque: Callable[[Any, Any, Any, Sequence[Any]], Any] | None = None
    step: Callable[[Any, Any, Any, Sequence[Any], Any], tuple[Any, Any]] | None = None
    passivity: Callable[[Sequence[Any]], Any] | None = None


def _linear(columns: Callable[[Any, Any], list[Any]]) -> Callable[[Any, Any, Sequence[Any]], Any]:
    def torque(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
        total: Any = 0
        for factor, value in zip(columns(ops, dq), p, strict=True):
            total = total + factor * value
        return total

    return torque


def coulomb_viscous_columns(ops: Any, dq: Any) -> list[Any]:
    """``[dq, sgn dq, 1]``. Source: (14.11)."""
    return [dq, ops.sign(dq), 1]


def asymmetric_columns(ops: Any, dq: Any) -> list[Any]:
    """``[dq+, dq-, s+, s-]``: speed and its sign, each split into its positive and its negative part."""
    s = ops.sign(dq)
    speed, both = dq * s, s * s
    return [(speed + dq) / 2, (dq - speed) / 2, (both + s) / 2, (s - both) / 2]


def stribeck_level(ops: Any, dq: Any, excess: Any, coulomb: Any, speed: Any) -> Any:
    """``gamma = alpha0 exp(-(dq/v_s)^2) + alpha1``. Source: (14.12)."""
    ratio = dq / speed
    return excess * ops.exp(-(ratio * ratio)) + coulomb


def _stribeck(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
    excess, coulomb, viscous, speed = p
    return stribeck_level(ops, dq, excess, coulomb, speed) * ops.sign(dq) + viscous * dq


def _lugre_sliding(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
    return _stribeck(ops, dq, p[2:])


def _lugre_relaxation(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
    """``sigma0 |dq| / gamma``, the rate at which the bristles forget, 1/s."""
    sigma0, _, excess, coulomb, _, speed = p
    return sigma0 * (dq * ops.sign(dq)) / stribeck_level(ops, dq, excess, coulomb, speed)


def _lugre_rate(ops: Any, z: Any, dq: Any, p: Sequence[Any]) -> Any:
    return dq - _lugre_relaxation(ops, dq, p) * z


def _lugre_torque(ops: Any, z: Any, dq: Any, p: Sequence[Any]) -> Any:
    return p[0] * z + p[1] * _lugre_rate(ops, z, dq, p) + p[4] * dq


def _lugre_step(ops: Any, z: Any, dq: Any, p: Sequence[Any], period: Any) -> tuple[Any, Any]:
    """Exact over a period of constant speed, hence bounded whatever the period.

    With ``x = sigma0 |dq| Ts / gamma`` and ``t = tanh(x/2)``: ``exp(-x) = (1-t)/(1+t)`` and ``1 - exp(-x) = 2t/(1+t)``,
    which loses no digits at small x.
    """
    sigma0, sigma1, excess, coulomb, viscous, speed = p
    t = ops.tanh(_lugre_relaxation(ops, dq, p) * period / 2)
    level = stribeck_level(ops, dq, excess, coulomb, speed) * ops.sign(dq) / sigma0
    following = z + (level - z) * (2 * t / (1 + t))
    return following, sigma0 * following + sigma1 * ((following - z) / period) + viscous * dq


def _lugre_passivity(p: Sequence[Any]) -> Any:
    """``alpha2 - sigma1 alpha0/alpha1``. Source: after (14.13)."""
    _, sigma1, excess, coulomb, viscous, _ = p
    return viscous - sigma1 * excess / coulomb


def _neural(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
    units = (len(p) - 1) // 2
    total = p[-1] * dq
    for f, w in zip(p[:units], p[units : 2 * units], strict=True):
        total = total + f * ops.tanh(w * dq)
    return total


def _logistic(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
    """Written with tanh, ``1/(1 + exp(-x)) = (1 + tanh(x/2))/2``, which cannot overflow."""
    span, steepness, shift = p
    half = steepness / 2
    return span / 2 * (ops.tanh(half * (dq + shift)) - ops.tanh(half * shift))


_VISCOUS = LawParameter("viscous", "N m s/rad", "viscous friction, alpha2")
_COULOMB = LawParameter("coulomb", "N m", "Coulomb friction, alpha1", positive=True)
_EXCESS = LawParameter("stiction_excess", "N m", "stiction minus Coulomb friction, alpha0")
_SPEED = LawParameter("stribeck_speed", "rad/s", "Stribeck velocity v_s", positive=True)

COULOMB_VISCOUS = FrictionLaw(
    "coulomb_viscous",
    "(14.11)",
    "tau_f = viscous dq + coulomb sgn(dq) + offset",
    (_VISCOUS, LawParameter("coulomb", "N m", "Coulomb friction, alpha1"), LawParameter("offset", "N m", "offset")),
    _linear(coulomb_viscous_columns),
    columns=coulomb_viscous_columns,
)
ASYMMETRIC = FrictionLaw(
    "asymmetric",
    "(14.11), one set of coefficients per direction",
    "tau_f = viscous_p dq + coulomb_p for dq > 0, viscous_n dq - coulomb_n for dq < 0, 0 at rest",
    (
        LawParameter("viscous_p", "N m s/rad", "viscous friction, dq > 0"),
        LawParameter("viscous_n", "N m s/rad", "viscous friction, dq < 0"),
        LawParameter("coulomb_p", "N m", "Coulomb friction, dq > 0"),
        LawParameter("coulomb_n", "N m", "magnitude of Coulomb friction, dq < 0"),
    ),
    _linear(asymmetric_columns),
    columns=asymmetric_columns,
)
STRIBECK = FrictionLaw(
    "stribeck",
    "(14.12)",
    "tau_f = (stiction_excess exp(-(dq/v_s)^2) + coulomb) sgn(dq) + viscous dq",
    (_EXCESS, _COULOMB, _VISCOUS, _SPEED),
    _stribeck,
)
LUGRE = FrictionLaw(
    "lugre",
    "(14.13)",
    "dz/dt = dq - sigma0 |dq| z / gamma(dq), tau_f = sigma0 z + sigma1 dz/dt + viscous dq",
    (
        LawParameter("sigma0", "N m/rad", "bristle stiffness", positive=True),
        LawParameter("sigma1", "N m s/rad", "bristle damping"),
        _EXCESS,
        _COULOMB,
        _VISCOUS,
        _SPEED,
    ),
    _lugre_sliding,
    rate=_lugre_rate,
    state_torque=_lugre_torque,
    step=_lugre_step,
    passivity=_lugre_passivity,
)
LOGISTIC = FrictionLaw(
    "logistic",
    "Gaz et al. 2019, IEEE Robotics and Automation Letters 4(4), for the Franka Emika Panda",
    "tau_f = span/(1 + exp(-steepness (dq + shift))) - span/(1 + exp(-steepness shift))",
    (
        LawParameter("span", "N m", "torque between fast motion backwards and forwards", positive=True),
        LawParameter("steepness", "s/rad", "steepness of the change of sign", positive=True),
        LawParameter("shift", "rad/s", "shift of the curve; other than 0 the directions differ"),
    ),
    _logistic,
)


def neural_law(units: int = 3) -> FrictionLaw:
    """The neural law (14.14) with ``units`` hyperbolic tangents (the chapter has three)."""
    names = [LawParameter(f"f{k + 1}", "N m", "output weight") for k in range(units)]
    names += [LawParameter(f"w{k + 1}", "s/rad", "input weight") for k in range(units)]
    return FrictionLaw("neural", "(14.14)", "tau_f = sum_k f_k tanh(w_k dq) + viscous dq", (*names, _VISCOUS), _neural)


_ALL = (COULOMB_VISCOUS, ASYMMETRIC, STRIBECK, LUGRE, LOGISTIC, neural_law())
LAWS: dict[str, FrictionLaw] = {law.name: law for law in _ALL}
"""Every law by name; the neural one with three units."""
