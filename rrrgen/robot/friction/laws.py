"""The friction laws of one joint: (14.11)-(14.14) and others of the literature.

Each is written once and evaluated on numbers, arrays or symbols: ``ops`` supplies ``ops.sign``, ``ops.exp`` and
``ops.tanh`` for NumPy, CasADi or a program builder. ``dq`` is the speed in rad/s (m/s), ``p`` the parameters in the
order that the law lists, ``s`` stands for sgn(dq). Torques are in N m (N).
Equation numbers (14.x): Kostic, de Jager, Steinbuch, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

# ------------------------------------------------------------------------------------------------------------------
# The interface of friction laws: torque, state and load dependence of the friction of one joint.
#
# A law is written once and evaluated on numbers, arrays or symbols: its argument ``ops`` supplies sgn, exp and tanh
# as ``ops.sign``, ``ops.exp``, ``ops.tanh`` for NumPy, CasADi or a program builder. Speeds ``dq`` are in rad/s (m/s),
# torques in N m (N), and sgn(0) = 0. Laws use |dq| only as ``dq sgn(dq)``, so that replacing sgn(x) by tanh(x/eps)
# makes every law smooth.
# ------------------------------------------------------------------------------------------------------------------

Factors = Callable[[Any, Any, Any, Sequence[Any]], list[Any]]
"""``factors(ops, dq, s, shapes)``: the factors of the linear parameters of a law."""


COULOMB, LOAD = "coulomb", "load_ratio"
LEAST = 1e-9  # value of a parameter that must be positive and was estimated as 0 or less


class LawParameter(NamedTuple):
    """One coefficient of a friction law: ``name``, ``unit`` at a revolute joint, ``meaning`` in words.

    ``positive`` marks a coefficient that must be above zero.
    """

    name: str
    unit: str
    meaning: str
    positive: bool = False


class Substitution(NamedTuple):
    """Shapes of which some are no parameters of the law but functions of them, like a ratio of two torques.

    ``replaced`` names the nonlinear parameters; ``shapes(p)`` computes the shapes from the parameters p (name ->
    value), and ``values(linear, shapes)`` the nonlinear parameters (name -> value) from the linear ones and the shapes.
    """

    replaced: tuple[str, ...]
    shapes: Callable[[Mapping[str, Any]], Sequence[Any]]
    values: Callable[[Mapping[str, Any], Sequence[Any]], Mapping[str, Any]]


@dataclass(frozen=True)
class FrictionLaw:
    """A friction law of one joint: the friction torque as a function of the speed dq and the parameters p.

    ``name`` is that of robot files, ``formula`` the law as text, ``equation`` its source, ``parameters`` describes p.
    ``torque(ops, dq, p)`` is the torque, in steady sliding if the law has a state. ``columns(ops, dq)`` are the partial
    derivatives of the torque by the parameters if the law is linear in all of them. A law with a ``rate`` has a state z
    (a deflection): ``dz/dt = rate(ops, z, dq, p)``, torque ``state_torque(ops, z, dq, p)``;
    ``step(ops, z, dq, p, period)`` returns z and the torque after a period; ``bristles(ops, dq, p)`` returns the
    deflection in steady sliding forwards and the damping, the torque per dz/dt. ``passivity(p)`` is a margin: where it
    is not negative, the law is passive.

    A law is linear in all parameters except those named in ``shapes``, which are positive, or those that the shapes
    replace by a ``substitution``. ``factors(ops, dq, s, shapes)`` are the derivatives by the linear ones, in their
    order, for given values of the shapes, with s = sgn(dq), or z relative to its value in steady sliding forwards if
    the law has a state. The linear parameter named ``damping``, if any, multiplies dz/dt.

    A *load-dependent* law has ``load_ratio`` as its last linear parameter: the Coulomb friction is raised by this ratio
    times the magnitude of the torque that the joint carries without friction. :meth:`under_load` returns the parameters
    for such a torque; the functions above take these and do not see the ratio.
    """

    name: str
    equation: str
    formula: str
    parameters: tuple[LawParameter, ...]
    torque: Callable[[Any, Any, Sequence[Any]], Any]
    factors: Factors
    columns: Callable[[Any, Any], list[Any]] | None = None
    rate: Callable[[Any, Any, Any, Sequence[Any]], Any] | None = None
    state_torque: Callable[[Any, Any, Any, Sequence[Any]], Any] | None = None
    step: Callable[[Any, Any, Any, Sequence[Any], Any], tuple[Any, Any]] | None = None
    bristles: Callable[[Any, Any, Sequence[Any]], tuple[Any, Any]] | None = None
    passivity: Callable[[Sequence[Any]], Any] | None = None
    shapes: tuple[str, ...] = ()
    substitution: Substitution | None = None
    damping: str = ""

    @property
    def has_load(self) -> bool:
        """Whether the Coulomb friction depends on the torque that the joint carries (parameter ``load_ratio``)."""
        return any(p.name == LOAD for p in self.parameters)

    def under_load(self, p: Sequence[Any], size: Any) -> Sequence[Any]:
        """The parameters ``p`` with the Coulomb friction raised for a load torque of magnitude ``size``, N m (N)."""
        if not self.has_load:
            return p
        names = [parameter.name for parameter in self.parameters]
        raised = p[names.index(COULOMB)] + p[names.index(LOAD)] * size
        return [raised if name == COULOMB else value for name, value in zip(names, p, strict=True)]

    @property
    def linear(self) -> tuple[LawParameter, ...]:
        """The parameters in which the torque is linear for given shapes."""
        bent = self.shapes if self.substitution is None else self.substitution.replaced
        return tuple(p for p in self.parameters if p.name not in bent)

    def split(self, p: Sequence[Any]) -> tuple[list[Any], list[Any]]:
        """Convert the values ``p`` of all parameters to those of the linear ones and those of the ``shapes``."""
        known = dict(zip((parameter.name for parameter in self.parameters), p, strict=True))
        shapes = [known[name] for name in self.shapes] if self.substitution is None else self.substitution.shapes(known)
        return [known[parameter.name] for parameter in self.linear], list(shapes)

    def join(self, linear: Sequence[Any], shapes: Sequence[Any]) -> tuple[Any, ...]:
        """Values of all parameters in the order of ``parameters``, from the linear ones and the shapes."""
        known = dict(zip((parameter.name for parameter in self.linear), linear, strict=True))
        if self.substitution is None:
            known |= dict(zip(self.shapes, shapes, strict=True))
        else:
            known |= self.substitution.values(known, shapes)
        return tuple(known[parameter.name] for parameter in self.parameters)

    def reach(self, ops: Any, dq: Any, shapes: Sequence[Any]) -> Any:
        """Deflection in steady sliding forwards at the speed ``dq``, rad (m); the ``shapes`` alone determine it."""
        assert self.bristles is not None
        return self.bristles(ops, dq, self.join([1] * len(self.linear), shapes))[0]


def linear_torque(columns: Callable[[Any, Any], list[Any]]) -> Callable[[Any, Any, Sequence[Any]], Any]:
    """Torque function of a law that is linear in all parameters: ``torque(ops, dq, p) = columns(ops, dq) . p``."""

    def torque(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
        total: Any = 0
        for factor, value in zip(columns(ops, dq), p, strict=True):
            total = total + factor * value
        return total

    return torque


def separable(
    name: str,
    equation: str,
    formula: str,
    parameters: Sequence[LawParameter],
    factors: Factors,
    shapes: tuple[str, ...] = (),
    presliding: bool = False,
) -> FrictionLaw:
    """Build a separable friction law: torque = ``factors(ops, dq, s, shapes)`` . (linear parameters).

    ``shapes`` names the nonlinear parameters, ``s`` is sgn(dq). With ``presliding`` the law has a state z, s is z/s0,
    and the last shape is the distance s0 over which friction builds up when the motion reverses:
    ``dz/dt = dq - |dq| z / s0`` (Dahl 1968), so that z = s0 sgn(dq) in steady sliding.
    """

    def total(ops: Any, dq: Any, s: Any, p: Sequence[Any]) -> Any:
        linear, bent = law.split(p)
        value: Any = 0
        for factor, weight in zip(factors(ops, dq, s, bent), linear, strict=not law.has_load):
            value = value + factor * weight
        return value

    def torque(ops: Any, dq: Any, p: Sequence[Any]) -> Any:
        return total(ops, dq, ops.sign(dq), p)

    def distance(p: Sequence[Any]) -> Any:
        return law.split(p)[1][-1]

    def rate(ops: Any, z: Any, dq: Any, p: Sequence[Any]) -> Any:
        return dq - dq * ops.sign(dq) / distance(p) * z

    def state_torque(ops: Any, z: Any, dq: Any, p: Sequence[Any]) -> Any:
        return total(ops, dq, z / distance(p), p)

    def step(ops: Any, z: Any, dq: Any, p: Sequence[Any], period: Any) -> tuple[Any, Any]:
        s0 = distance(p)
        following = z + (s0 * ops.sign(dq) - z) * forgotten(ops, dq * ops.sign(dq) / s0, period)
        return following, state_torque(ops, following, dq, p)

    def bristles(ops: Any, dq: Any, p: Sequence[Any]) -> tuple[Any, Any]:
        return distance(p), 0

    law = FrictionLaw(name, equation, formula, tuple(parameters), torque, factors, shapes=shapes)
    if not presliding:
        return law
    return replace(law, rate=rate, state_torque=state_torque, step=step, bristles=bristles)


def forgotten(ops: Any, relaxation: Any, period: Any) -> Any:
    """Fraction ``1 - exp(-relaxation period)`` by which a state approaches its equilibrium in one period.

    ``relaxation`` is the rate in 1/s, ``period`` in s. The fraction is computed as 2t/(1+t) with
    t = tanh(relaxation period / 2), which loses no digits where the product is small.
    """
    t = ops.tanh(relaxation * period / 2)
    return 2 * t / (1 + t)


# ------------------------------------------------------------------------------------------------------------------
# The friction laws of one joint
# ------------------------------------------------------------------------------------------------------------------


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
