"""The interface of friction laws: torque, state and load dependence of one joint's friction, in any arithmetic.

``ops`` supplies sgn, exp and tanh as ``ops.sign``, ``ops.exp``, ``ops.tanh``: a program builder, NumPy, or CasADi.
Speeds ``dq`` are in rad/s (m/s), torques in N m (N), with sgn(0) = 0. No law uses |dq| other than as ``dq sgn(dq)``, so
that replacing sgn by tanh(./eps) alone makes all of them smooth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

Factors = Callable[[Any, Any, Any, Sequence[Any]], list[Any]]
"""``factors(ops, dq, s, shapes)``: the factors of the linear parameters of a law."""


COULOMB, LOAD = "coulomb", "load_ratio"


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

    A *separable* law is linear in all parameters but its ``shapes``: ``factors(ops, dq, s, shapes)`` are the factors of
    the others, in their order, with s = sgn(dq), or z / ``shapes[-1]`` if the law has a state.

    A *load-dependent* law has the parameter ``load_ratio``, the last of the linear ones: the torque of the load, which
    is that of the rigid body at the joint without friction, raises the Coulomb friction by its magnitude times the
    ratio. :meth:`under_load` gives the parameters at a load; the functions above and ``factors`` leave the ratio out.
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
    shapes: tuple[str, ...] = ()
    factors: Factors | None = None

    @property
    def has_load(self) -> bool:
        """Whether the Coulomb friction depends on the torque of the load."""
        return any(p.name == LOAD for p in self.parameters)

    def under_load(self, p: Sequence[Any], size: Any) -> Sequence[Any]:
        """The parameters ``p`` with the Coulomb friction raised by a load torque of magnitude ``size``, N m (N)."""
        if not self.has_load:
            return p
        names = [each.name for each in self.parameters]
        raised = p[names.index(COULOMB)] + p[names.index(LOAD)] * size
        return [raised if name == COULOMB else value for name, value in zip(names, p, strict=True)]

    @property
    def linear(self) -> tuple[LawParameter, ...]:
        """The parameters in which the torque is linear, all that are not ``shapes``."""
        return tuple(p for p in self.parameters if p.name not in self.shapes)

    def split(self, p: Sequence[Any]) -> tuple[list[Any], list[Any]]:
        """The values of the linear parameters and those of the shapes, from all parameters ``p`` in order."""
        known = dict(zip((each.name for each in self.parameters), p, strict=True))
        return [known[each.name] for each in self.linear], [known[name] for name in self.shapes]

    def joined(self, linear: Sequence[Any], shapes: Sequence[Any]) -> tuple[Any, ...]:
        """All parameters in order, from the values of the linear ones and those of the shapes."""
        known = dict(zip((each.name for each in self.linear), linear, strict=True))
        known |= dict(zip(self.shapes, shapes, strict=True))
        return tuple(known[each.name] for each in self.parameters)


def linear_torque(columns: Callable[[Any, Any], list[Any]]) -> Callable[[Any, Any, Sequence[Any]], Any]:
    """The torque of a law that is linear in all its parameters, from their factors ``columns(ops, dq)``."""

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
    """Build a friction law from the ``factors`` of its linear parameters; ``shapes`` are the nonlinear ones.

    With ``presliding``, the last shape is the distance s0 over which friction builds up when the motion reverses, and z
    obeys ``dz/dt = dq - |dq| z / s0`` (Dahl 1968), so that z = s0 sgn(dq) in sliding.
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

    law = FrictionLaw(name, equation, formula, tuple(parameters), torque, shapes=shapes, factors=factors)
    return replace(law, rate=rate, state_torque=state_torque, step=step) if presliding else law


def forgotten(ops: Any, relaxation: Any, period: Any) -> Any:
    """The share ``1 - exp(-relaxation period)`` by which a state relaxes in one period.

    Computed as 2t/(1+t) with t = tanh(relaxation period / 2), which loses no digits where the product is small.
    """
    t = ops.tanh(relaxation * period / 2)
    return 2 * t / (1 + t)
