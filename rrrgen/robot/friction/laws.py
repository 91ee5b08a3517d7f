"""The friction laws of one joint: (14.11)-(14.14) and others of the literature.

Each is written once and evaluated on numbers, arrays or symbols: ``ops`` supplies ``ops.sign``, ``ops.exp`` and
``ops.tanh`` for NumPy, CasADi or a program builder. ``dq`` is the speed in rad/s (m/s), ``p`` the parameters in the
order that the law lists, ``s`` stands for sgn(dq). Torques are in N m (N).
Equation numbers (14.x): Kostic, de Jager, Steinbuch, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rrrgen.robot.friction.law import LOAD, FrictionLaw, LawParameter, Substitution, forgotten, linear_torque, separable


def coulomb_viscous_columns(ops: Any, dq: Any) -> list[Any]:
    """Factors of the viscous, Coulomb and offset parameters: ``[dq, sgn dq, 1]``. Source: (14.11)."""
    return [dq, ops.sign(dq), 1]


def asymmetric_columns(ops: Any, dq: Any) -> list[Any]:
    """Factors of friction that differs by direction: ``[max(dq, 0), min(dq, 0), max(s, 0), min(s, 0)]``, s = sgn dq.

    The parameters are the viscous coefficients for either direction, then the Coulomb torques.
    """
    s = ops.sign(dq)
    speed, both = dq * s, s * s
    return [(speed + dq) / 2, (dq - speed) / 2, (both + s) / 2, (s - both) / 2]


def _coulomb_viscous_factors(ops: Any, dq: Any, s: Any, shapes: Sequence[Any]) -> list[Any]:
    return [dq, s, 1]


def _asymmetric_factors(ops: Any, dq: Any, s: Any, shapes: Sequence[Any]) -> list[Any]:
    return asymmetric_columns(ops, dq)


def _decay(ops: Any, dq: Any, speed: Any) -> Any:
    """Factor ``exp(-|dq| / speed)`` by which additional friction at low speed decays; ``speed`` in rad/s (m/s)."""
    return ops.exp(-(dq * ops.sign(dq)) / speed)


def _exponential_factors(ops: Any, dq: Any, s: Any, shapes: Sequence[Any]) -> list[Any]:
    return [s * _decay(ops, dq, shapes[0]), s, dq]


def _asymmetric_exponential_factors(ops: Any, dq: Any, s: Any, shapes: Sequence[Any]) -> list[Any]:
    return [*asymmetric_columns(ops, dq), s * _decay(ops, dq, shapes[0])]


def _coulomb_factors(ops: Any, dq: Any, s: Any, shapes: Sequence[Any]) -> list[Any]:
    return [s, dq]


def _dahl_exponential_factors(ops: Any, dq: Any, s: Any, shapes: Sequence[Any]) -> list[Any]:
    return [s * _decay(ops, dq, shapes[0]), s, dq, dq * (dq * ops.sign(dq))]


def stribeck_level(ops: Any, dq: Any, excess: Any, coulomb: Any, speed: Any) -> Any:
    """Stribeck curve of sliding friction: ``gamma = alpha0 exp(-(dq/v_s)^2) + alpha1``, N m (N). Source: (14.12).

    ``excess`` is alpha0, ``coulomb`` alpha1 and ``speed`` v_s.
    """
    ratio = dq / speed
    return excess * ops.exp(-(ratio * ratio)) + coulomb


def _stribeck_factors(ops: Any, dq: Any, s: Any, shapes: Sequence[Any]) -> list[Any]:
    return [s * stribeck_level(ops, dq, 1, 0, shapes[0]), s, dq]


def _stribeck(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
    excess, coulomb, viscous, speed = p
    return stribeck_level(ops, dq, excess, coulomb, speed) * ops.sign(dq) + viscous * dq


def _lugre_sliding(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
    return _stribeck(ops, dq, p[2:])


def _lugre_relaxation(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
    """Relaxation rate of the bristle deflection, ``sigma0 |dq| / gamma``, 1/s."""
    sigma0, _, excess, coulomb, _, speed = p
    return sigma0 * (dq * ops.sign(dq)) / stribeck_level(ops, dq, excess, coulomb, speed)


def _lugre_rate(ops: Any, z: Any, dq: Any, p: Sequence[Any]) -> Any:
    return dq - _lugre_relaxation(ops, dq, p) * z


def _lugre_torque(ops: Any, z: Any, dq: Any, p: Sequence[Any]) -> Any:
    return p[0] * z + p[1] * _lugre_rate(ops, z, dq, p) + p[4] * dq


def _lugre_step(ops: Any, z: Any, dq: Any, p: Sequence[Any], period: Any) -> tuple[Any, Any]:
    """Bristle deflection and torque of the LuGre law after ``period`` (s) at constant speed.

    The solution is exact for constant speed and therefore stable for any period.
    """
    sigma0, sigma1, excess, coulomb, viscous, speed = p
    level = stribeck_level(ops, dq, excess, coulomb, speed) * ops.sign(dq) / sigma0
    following = z + (level - z) * forgotten(ops, _lugre_relaxation(ops, dq, p), period)
    return following, sigma0 * following + sigma1 * ((following - z) / period) + viscous * dq


def _lugre_bristles(ops: Any, dq: Any, p: Sequence[Any]) -> tuple[Any, Any]:
    sigma0, sigma1, excess, coulomb, _, speed = p
    return stribeck_level(ops, dq, excess, coulomb, speed) / sigma0, sigma1


def _lugre_factors(ops: Any, dq: Any, s: Any, shapes: Sequence[Any]) -> list[Any]:
    ratio, speed, _ = shapes
    return [dq - dq * ops.sign(dq) * s, s * stribeck_level(ops, dq, ratio - 1, 1, speed), dq]


def _lugre_shapes(p: Mapping[str, Any]) -> list[Any]:
    coulomb = p["coulomb"]
    return [1 + p["stiction_excess"] / coulomb, p["stribeck_speed"], coulomb / p["sigma0"]]


def _lugre_values(linear: Mapping[str, Any], shapes: Sequence[Any]) -> dict[str, Any]:
    (ratio, speed, distance), coulomb = shapes, linear["coulomb"]
    return {"sigma0": coulomb / distance, "stiction_excess": (ratio - 1) * coulomb, "stribeck_speed": speed}


def _lugre_passivity(p: Sequence[Any]) -> Any:
    """Passivity margin of the LuGre law, ``alpha2 - sigma1 alpha0/alpha1``: passive if >= 0. Source: after (14.13)."""
    _, sigma1, excess, coulomb, viscous, _ = p
    return viscous - sigma1 * excess / coulomb


def _neural(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
    units = (len(p) - 1) // 2
    total = p[-1] * dq
    for f, w in zip(p[:units], p[units : 2 * units], strict=True):
        total = total + f * ops.tanh(w * dq)
    return total


def _neural_factors(ops: Any, dq: Any, s: Any, shapes: Sequence[Any]) -> list[Any]:
    return [*(ops.tanh(w * dq) for w in shapes), dq]


def _logistic(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
    """Torque of the logistic friction law, with ``1/(1 + exp(-x)) = (1 + tanh(x/2))/2``, which cannot overflow."""
    span, steepness, shift = p
    half = steepness / 2
    return span / 2 * (ops.tanh(half * (dq + shift)) - ops.tanh(half * shift))


def _logistic_factors(ops: Any, dq: Any, s: Any, shapes: Sequence[Any]) -> list[Any]:
    steepness, ratio = shapes
    t = ops.tanh(steepness / 2 * dq)
    return [2 * ratio * t / ((1 + ratio) * (1 + ratio + (ratio - 1) * t))]


def _logistic_shapes(p: Mapping[str, Any]) -> list[Any]:
    return [p["steepness"], math.exp(p["steepness"] * p["shift"])]


def _logistic_values(linear: Mapping[str, Any], shapes: Sequence[Any]) -> dict[str, Any]:
    steepness, ratio = shapes
    return {"steepness": steepness, "shift": math.log(ratio) / steepness}


_VISCOUS = LawParameter("viscous", "N m s/rad", "viscous friction, alpha2")
_COULOMB = LawParameter("coulomb", "N m", "Coulomb friction, alpha1", positive=True)
_EXCESS = LawParameter("stiction_excess", "N m", "stiction minus Coulomb friction, alpha0")
_SPEED = LawParameter("stribeck_speed", "rad/s", "Stribeck velocity v_s", positive=True)
_COULOMB_ANY = LawParameter("coulomb", "N m", "Coulomb friction, alpha1")
_FREE_EXCESS = LawParameter("excess", "N m", "friction at rest minus Coulomb friction, of either sign")
_QUADRATIC = LawParameter("quadratic", "N m s^2/rad^2", "change of viscous friction with the speed")
_DECAY = LawParameter("decay_speed", "rad/s", "speed over which the excess decays by e", positive=True)
_LOAD = LawParameter(LOAD, "-", "Coulomb friction per torque of the load")
_PRESLIDING = LawParameter("presliding", "rad", "motion over which friction builds up by 1 - 1/e", positive=True)

COULOMB_VISCOUS = FrictionLaw(
    "coulomb_viscous",
    "(14.11)",
    "tau_f = viscous dq + coulomb sgn(dq) + offset",
    (_VISCOUS, _COULOMB_ANY, LawParameter("offset", "N m", "offset")),
    linear_torque(coulomb_viscous_columns),
    columns=coulomb_viscous_columns,
    factors=_coulomb_viscous_factors,
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
    linear_torque(asymmetric_columns),
    columns=asymmetric_columns,
    factors=_asymmetric_factors,
)
STRIBECK = FrictionLaw(
    "stribeck",
    "(14.12)",
    "tau_f = (stiction_excess exp(-(dq/v_s)^2) + coulomb) sgn(dq) + viscous dq",
    (_EXCESS, _COULOMB, _VISCOUS, _SPEED),
    _stribeck,
    shapes=("stribeck_speed",),
    factors=_stribeck_factors,
)
EXPONENTIAL = separable(
    "exponential",
    "as (14.12) with a decay of first order",
    "tau_f = (excess exp(-|dq|/decay_speed) + coulomb) sgn(dq) + viscous dq",
    (_FREE_EXCESS, _COULOMB_ANY, _VISCOUS, _DECAY),
    _exponential_factors,
    ("decay_speed",),
)
ASYMMETRIC_EXPONENTIAL = separable(
    "asymmetric_exponential",
    "(14.11), one set of coefficients per direction, with a term that decays with the speed",
    "tau_f = viscous_p dq + coulomb_p for dq > 0, viscous_n dq - coulomb_n for dq < 0, "
    "+ excess exp(-|dq|/decay_speed) sgn(dq)",
    (*ASYMMETRIC.parameters, _FREE_EXCESS, _DECAY),
    _asymmetric_exponential_factors,
    ("decay_speed",),
)
DAHL = separable(
    "dahl",
    "Dahl 1968",
    "dz/dt = dq - |dq| z / presliding, tau_f = coulomb z / presliding + viscous dq",
    (_COULOMB_ANY, _VISCOUS, _PRESLIDING),
    _coulomb_factors,
    ("presliding",),
    presliding=True,
)
DAHL_EXPONENTIAL = separable(
    "dahl_exponential",
    "Dahl 1968, with a level that depends on the speed",
    "dz/dt = dq - |dq| z / presliding, tau_f = (excess exp(-|dq|/decay_speed) + coulomb) z / presliding + viscous dq "
    "+ quadratic dq |dq|",
    (
        _FREE_EXCESS,
        _COULOMB_ANY,
        _VISCOUS,
        _QUADRATIC,
        _DECAY,
        _PRESLIDING,
    ),
    _dahl_exponential_factors,
    ("decay_speed", "presliding"),
    presliding=True,
)
LOAD_DEPENDENT = separable(
    "load_dependent",
    "(14.11), with Coulomb friction that grows with the load (Hamon et al. 2010)",
    "tau_f = (coulomb + load_ratio |tau_load|) sgn(dq) + viscous dq",
    (_COULOMB_ANY, _VISCOUS, _LOAD),
    _coulomb_factors,
)
DAHL_LOAD_DEPENDENT = separable(
    "dahl_load_dependent",
    "Dahl 1968, with a level that depends on speed and load",
    "dz/dt = dq - |dq| z / presliding, tau_f = (excess exp(-|dq|/decay_speed) + coulomb + load_ratio |tau_load|) "
    "z / presliding + viscous dq + quadratic dq |dq|",
    (_FREE_EXCESS, _COULOMB_ANY, _VISCOUS, _QUADRATIC, _LOAD, _DECAY, _PRESLIDING),
    _dahl_exponential_factors,
    ("decay_speed", "presliding"),
    presliding=True,
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
    bristles=_lugre_bristles,
    passivity=_lugre_passivity,
    # ratio of stiction to Coulomb friction, and the motion coulomb/sigma0 over which bristles bend
    shapes=("stiction_ratio", "stribeck_speed", "presliding"),
    factors=_lugre_factors,
    substitution=Substitution(("sigma0", "stiction_excess", "stribeck_speed"), _lugre_shapes, _lugre_values),
    damping="sigma1",
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
    # ratio of friction backwards to friction forwards in fast motion, exp(steepness shift)
    shapes=("steepness", "direction_ratio"),
    factors=_logistic_factors,
    substitution=Substitution(("steepness", "shift"), _logistic_shapes, _logistic_values),
)


def neural_law(units: int = 3) -> FrictionLaw:
    """The neural-network friction law (14.14), a sum of ``units`` hyperbolic tangents; the source has three."""
    names = [LawParameter(f"f{k + 1}", "N m", "output weight") for k in range(units)]
    names += [LawParameter(f"w{k + 1}", "s/rad", "input weight") for k in range(units)]
    return FrictionLaw(
        "neural",
        "(14.14)",
        "tau_f = sum_k f_k tanh(w_k dq) + viscous dq",
        (*names, _VISCOUS),
        _neural,
        shapes=tuple(f"w{k + 1}" for k in range(units)),
        factors=_neural_factors,
    )


_ALL = (
    COULOMB_VISCOUS,
    ASYMMETRIC,
    EXPONENTIAL,
    ASYMMETRIC_EXPONENTIAL,
    STRIBECK,
    DAHL,
    DAHL_EXPONENTIAL,
    LOAD_DEPENDENT,
    DAHL_LOAD_DEPENDENT,
    LUGRE,
    LOGISTIC,
    neural_law(),
)
LAWS: dict[str, FrictionLaw] = {law.name: law for law in _ALL}
"""Every law by name; the neural one with three units."""
