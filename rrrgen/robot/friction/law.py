"""The interface of friction laws: torque, state and load dependence of the friction of one joint.

A law is written once and evaluated on numbers, arrays or symbols: its argument ``ops`` supplies sgn, exp and tanh as
``ops.sign``, ``ops.exp``, ``ops.tanh`` for NumPy, CasADi or a program builder. Speeds ``dq`` are in rad/s (m/s),
torques in N m (N), and sgn(0) = 0. Laws use |dq| only as ``dq sgn(dq)``, so that replacing sgn(x) by tanh(x/eps) makes
every law smooth.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

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
        names = [each.name for each in self.parameters]
        raised = p[names.index(COULOMB)] + p[names.index(LOAD)] * size
        return [raised if name == COULOMB else value for name, value in zip(names, p, strict=True)]

    @property
    def linear(self) -> tuple[LawParameter, ...]:
        """The parameters in which the torque is linear for given shapes."""
        bent = self.shapes if self.substitution is None else self.substitution.replaced
        return tuple(p for p in self.parameters if p.name not in bent)

    def split(self, p: Sequence[Any]) -> tuple[list[Any], list[Any]]:
        """Convert the values ``p`` of all parameters to those of the linear ones and those of the ``shapes``."""
        known = dict(zip((each.name for each in self.parameters), p, strict=True))
        shapes = [known[name] for name in self.shapes] if self.substitution is None else self.substitution.shapes(known)
        return [known[each.name] for each in self.linear], list(shapes)

    def joined(self, linear: Sequence[Any], shapes: Sequence[Any]) -> tuple[Any, ...]:
        """Values of all parameters in the order of ``parameters``, from the linear ones and the shapes."""
        known = dict(zip((each.name for each in self.linear), linear, strict=True))
        if self.substitution is None:
            known |= dict(zip(self.shapes, shapes, strict=True))
        else:
            known |= self.substitution.values(known, shapes)
        return tuple(known[each.name] for each in self.parameters)

    def reach(self, ops: Any, dq: Any, shapes: Sequence[Any]) -> Any:
        """Deflection in steady sliding forwards at the speed ``dq``, rad (m); the ``shapes`` alone determine it."""
        assert self.bristles is not None
        return self.bristles(ops, dq, self.joined([1] * len(self.linear), shapes))[0]


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
