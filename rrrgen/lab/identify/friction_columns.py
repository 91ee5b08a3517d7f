"""Friction laws of joints and motors in the regressor: columns of the linear parameters for known shapes.

A separable law is linear in all parameters but its shapes (:mod:`rrrgen.robot.friction.laws`). With known shapes its
factors are columns of the regressor, evaluated at every recorded sample and filtered like all others. Where a law has a
state, its direction s follows the motion: ``ds/dx = (1 - s sgn(dx)) / presliding``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.identify.parameters import Column, CoupledDrive, DriveTerms
from rrrgen.robot.friction.laws import LAWS, FrictionLaw
from rrrgen.robot.friction.models import NUMPY
from rrrgen.robot.model.drives import KINDS, unit
from rrrgen.robot.spec import FrictionSpec, LawSpec
from rrrgen.runtime.regressor_columns import STANDSTILL

BOUNDED = ("viscous", "coulomb", "viscous_p", "viscous_n", "coulomb_p", "coulomb_n", "sigma1", "span")
"""Parameters that a physically consistent estimate keeps from being negative."""


@dataclass(frozen=True)
class FrictionSurface:
    """Friction surface: a joint or motor with the friction ``law`` and its shape parameters ``shapes``.

    With its ``direction`` w (n,), the surface slides at the speed ``w dq``, and its friction f adds ``w' f`` to the
    joint torques. The load torque that it transmits is ``carried`` (n,) times the joint torques without friction. Its
    parameter names end in ``owner``.
    """

    owner: str
    direction: tuple[float, ...]
    law: str
    shapes: tuple[float, ...] = ()
    carried: tuple[float, ...] = ()

    @property
    def definition(self) -> FrictionLaw:
        """The friction law with its functions."""
        return LAWS[self.law]

    @property
    def has_state(self) -> bool:
        """Whether the law has a state: then friction reverses gradually after a reversal of the motion, not at once."""
        return self.definition.rate is not None

    @property
    def is_two_sided(self) -> bool:
        """Whether the law has separate coefficients for the two directions of motion."""
        return any(p.name == "coulomb_n" for p in self.definition.parameters)

    @property
    def joints(self) -> tuple[int, ...]:
        """The joints (from 0) on which the friction acts."""
        return tuple(i for i, weight in enumerate(self.direction) if weight)

    def columns(self) -> tuple[Column, ...]:
        """Descriptions of the regressor columns of the law's linear parameters."""
        return tuple(
            Column(f"{p.name}{self.owner}", "law", self.direction, p.unit, p.meaning, p.name in BOUNDED, p.name)
            for p in self.definition.linear
        )

    def factors(self, dq: Array, s: Array | None, load: Array | None = None) -> Array:
        """Factors (N, k) by which the k linear parameters enter the friction at the joint speeds ``dq`` (N, n).

        ``s`` (N,) is the direction of friction, -1 to 1.
        Without ``s``, or for a law without a state, s is the sign of the speed, which is 0 up to :data:`STANDSTILL`.
        ``load`` (N, n) are the joint torques without friction, zero if not given.
        """
        speed = along(self.direction, dq)
        speed = np.where(np.abs(speed) > STANDSTILL, speed, 0.0)
        at = np.sign(speed) if s is None or not self.has_state else s
        law = self.definition
        factors = [factor + 0.0 * speed for factor in law.factors(NUMPY, speed, at, self.shapes)]
        if law.has_load:
            factors.append(at * np.abs(along(self.carried, load)) if load is not None else 0.0 * speed)
        return np.stack(factors, axis=-1)


def along(direction: Sequence[float], values: Array) -> Array:
    """Component ``w . values`` (N,) of the joint ``values`` (N, n) along the ``direction`` w (n,)."""
    return np.asarray(sum(w * values[..., i] for i, w in enumerate(direction) if w))


def law_columns(
    surfaces: Sequence[FrictionSurface], dq: Array, s: Array | None = None, load: Array | None = None
) -> Array:
    """Regressor columns (N, n, k) of all ``surfaces`` at the joint speeds ``dq`` (N, n).

    ``s`` (N, m) are the directions, -1 to 1, of the m surfaces with a state.
    ``load`` (N, n) are the joint torques without friction, for laws that depend on the load.
    """
    n, parts, state = dq.shape[-1], [], 0
    for surface in surfaces:
        friction_direction = None if s is None or not surface.has_state else s[..., state]
        state += int(surface.has_state)
        weights = np.array([surface.direction[i] for i in range(n)])
        parts.append(weights[:, None] * surface.factors(dq, friction_direction, load)[..., None, :])
    return np.concatenate(parts, axis=-1) if parts else np.zeros((*dq.shape, 0))


@dataclass(frozen=True)
class Sliding:
    """Computes the direction of friction, -1 to 1, along a motion, for every surface whose law has a state."""

    surfaces: tuple[FrictionSurface, ...]

    @classmethod
    def of(cls, surfaces: Sequence[FrictionSurface]) -> Sliding | None:
        """Select the ``surfaces`` whose law has a state; None if there is none."""
        moved = tuple(surface for surface in surfaces if surface.has_state)
        return cls(moved) if moved else None

    def start(self) -> Array:
        """Directions (m,) at the beginning of a stretch: 0, no friction."""
        return np.zeros(len(self.surfaces))

    def states(self, q: Array, dq: Array, start: Array) -> Array:
        """Directions (N, m) along positions ``q`` and speeds ``dq`` (N, n), from ``start`` (m,) at the first sample.

        A direction is the deflection of the bristles relative to that in steady sliding at the same speed. Exact
        between samples for the mean of their speeds: over the travel x in one direction, the deflection approaches that
        in steady sliding, ``reach``, by exp(-|x| / reach).
        """
        x, v = (np.stack([along(surface.direction, y) for surface in self.surfaces], axis=-1) for y in (q, dq))
        travel, reach = np.diff(x, axis=0), self._reach((v[1:] + v[:-1]) / 2.0)
        kept = np.exp(-np.abs(travel) / reach)
        added = -np.expm1(-np.abs(travel) / reach) * np.sign(travel) * reach
        deflections = self._reach(v)
        return (
            recursion(np.vstack([np.zeros_like(start), kept]), np.vstack([start * deflections[0], added])) / deflections
        )

    def _reach(self, v: Array) -> Array:
        """Deflections (N, m) in steady sliding forwards at the sliding speeds ``v`` (N, m)."""
        deflections = [
            surface.definition.reach(NUMPY, v[:, k], surface.shapes) for k, surface in enumerate(self.surfaces)
        ]
        return np.stack([np.broadcast_to(value, len(v)) for value in deflections], axis=-1)


def recursion(a: Array, b: Array) -> Array:
    """``y_k = a_k y_{k-1} + b_k`` (N, m) with ``y_{-1} = 0``, all samples at once by repeated doubling; 0 <= a <= 1."""
    a, y, shift = a.copy(), b.copy(), 1
    while shift < len(y) and np.any(a[shift:]):
        y[shift:] = y[shift:] + a[shift:] * y[:-shift]
        a[shift:] = a[shift:] * a[:-shift]
        a[shift : 2 * shift] = 0.0
        shift *= 2
    return y


def stated_laws(spec: Any) -> list[tuple[FrictionSurface, LawSpec]]:
    """Joints and motors for which the robot file states a friction law, with its shapes, each paired with that law."""
    laws = []
    for owner, direction, carried, friction in _owners(spec):
        if friction is not None and friction.law is not None:
            law = LAWS[friction.law.name]
            shapes = tuple(law.split(friction.law.values)[1])
            laws.append((FrictionSurface(owner, direction, law.name, shapes, carried), friction.law))
    return laws


def stated_surfaces(spec: Any) -> tuple[FrictionSurface, ...]:
    """The joints and motors for which the robot file states a friction law."""
    return tuple(surface for surface, _ in stated_laws(spec))


def surfaces_with(spec: Any, law: str) -> tuple[FrictionSurface, ...]:
    """The joints and motors for which the robot file states friction, with the friction ``law`` and no shapes yet."""
    return tuple(
        FrictionSurface(owner, direction, law, carried=carried)
        for owner, direction, carried, friction in _owners(spec)
        if slides(friction)
    )


def slides(friction: FrictionSpec | None) -> bool:
    """Whether ``friction`` of the robot file has a term that depends on the speed: viscous, Coulomb, or another law."""
    return friction is not None and (friction.viscous, friction.coulomb, friction.law) != (None, None, None)


def _owners(spec: Any) -> list[tuple[str, tuple[float, ...], tuple[float, ...], FrictionSpec | None]]:
    """For every joint and every coupled motor: suffix of its parameter names, direction (n,), load (n,), friction.

    The direction maps joint speeds to the sliding speed, the load maps joint torques to the torque transmitted.
    """
    if spec is None:  # a model of equations alone
        return []
    owners = []
    for i, joint in enumerate(spec.joints):
        direction = tuple(float(w) for w in unit(i, spec.n))
        owners.append((f"{i + 1}", direction, direction, joint.friction))
    if spec.drives is not None:
        rows, inverse = spec.drives.motor_from_joint, spec.drives.joint_from_motor
        for k, motor in enumerate(spec.drives.motors):
            direction, carried = (tuple(float(w) for w in values) for values in (rows.row(k), inverse.col(k)))
            owners.append((f"_{motor.name}", direction, carried, motor.friction))
    return owners


def with_linear_friction(terms: DriveTerms, spec: Any) -> DriveTerms:
    """Add viscous and Coulomb friction to ``terms`` for joints and motors whose law in the robot file is another."""
    stated = {surface.owner: surface for surface in stated_surfaces(spec)}
    if not stated:
        return terms
    joints = tuple(i for i in range(spec.n) if f"{i + 1}" in stated)
    both: dict[str, Any] = {kind: tuple(sorted({*getattr(terms, kind), *joints})) for kind in ("viscous", "coulomb")}
    coupled = {drive.name: drive for drive in terms.coupled}
    for owner, surface in stated.items():
        if owner.startswith("_"):
            coupled_drive = coupled.get(owner[1:], CoupledDrive(owner[1:], surface.direction, ()))
            kinds = dict.fromkeys((*coupled_drive.terms, "viscous", "coulomb"))
            coupled[owner[1:]] = replace(coupled_drive, terms=tuple(kind for kind in KINDS if kind in kinds))
    return replace(terms, **both, coupled=tuple(coupled.values()))


def without_laws(terms: DriveTerms, surfaces: Sequence[FrictionSurface]) -> DriveTerms:
    """Remove viscous and Coulomb friction from ``terms`` for the joints and motors that are among ``surfaces``.

    If the law of a surface has separate coefficients for each direction, the offset is removed too: during motion it
    equals the difference between the two directions.
    """
    owners = {surface.owner for surface in surfaces}
    two_sided = {surface.owner for surface in surfaces if surface.is_two_sided}
    gone = {"viscous": owners, "coulomb": owners, "offset": two_sided}
    kept: dict[str, Any] = {
        kind: tuple(i for i in getattr(terms, kind) if f"{i + 1}" not in owner_names)
        for kind, owner_names in gone.items()
    }
    coupled: list[CoupledDrive] = []
    for drive in terms.coupled:
        kinds = tuple(kind for kind in drive.terms if f"_{drive.name}" not in gone.get(kind, ()))
        if kinds:
            coupled.append(replace(drive, terms=kinds))
    return replace(terms, **kept, coupled=tuple(coupled))
