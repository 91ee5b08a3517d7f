"""Recorders of the functions that compute base parameters: from link parameters, and with a payload added.

A payload is a rigid body that is fixed to the last link, so it adds the standard parameters ``phi_p`` (10,) to those of
that link. Base parameters are linear in the standard ones, ``beta = K phi``, hence exactly

    beta_loaded = beta + K_n phi_p,   K_n the ten columns of that link.

The drive inertias, which follow the parameters of the links in phi and beta, stay as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy as sp

from rrrgen.derive.functions.recording import FunctionBuilder, Recorder, drive_inertia_meaning
from rrrgen.derive.parameters.base_parameters import regroup
from rrrgen.derive.parameters.listing import TENSOR
from rrrgen.derive.parameters.user_basis import BasisChange
from rrrgen.derive.recursions.linear_algebra import Matrix, add, dot, product, scale, times, transpose
from rrrgen.derive.recursions.link_frames import Placement
from rrrgen.program import Port, Program, Role
from rrrgen.program.polynomials import to_expression
from rrrgen.robot.model import RigidTransform
from rrrgen.robot.spec import STANDARD

Parameters = Sequence[Sequence[Any]]


def through_projection(r: FunctionBuilder, phi: Parameters) -> list[Any]:
    """The base parameters ``K phi`` (b,) as the product of the matrix K, at nominal geometry, and phi."""
    flat = [value for link in phi for value in link]
    return [dot([r.constant(factor) for factor in row], flat) for row in r.parametrization.projection]


def by_regrouping(r: FunctionBuilder, phi: Parameters) -> list[Any]:
    """The base parameters ``K phi`` (b,) by moving each link's inertia to the previous link, from tip to base."""
    basis, change = r.parametrization.basis, r.parametrization.change

    def placement(X: RigidTransform) -> Placement:
        return Placement([[r.constant(X.R[i, j]) for j in range(3)] for i in range(3)], [r.constant(v) for v in X.p])

    candidate_values = regroup(r.model, placement, phi)
    values = {parameter: candidate_values[parameter] for parameter in basis.parameters}
    for dependency in basis.dependencies:
        for keeper, factor in dependency.combination.items():
            values[keeper] = values[keeper] + r.constant(factor) * candidate_values[dependency.parameter]
    compiler = [values[parameter] for parameter in basis.parameters]
    return compiler if change is None else through(r, change, compiler)


def through(r: FunctionBuilder, change: BasisChange, compiler: Sequence[Any]) -> list[Any]:
    """Convert base parameters ``compiler`` (b,), in the set that the compiler chose, to the user's set."""
    return [dot([r.constant(sp.S(to_expression(v))) for v in row], compiler) for row in change.forward]


Projection = Any


def base_parameters(project: Projection) -> Recorder:
    """Make a recorder of beta = K phi (b + drives,) from the standard parameters phi (10 n + drives,).

    ``project`` is the method that computes K phi: :func:`through_projection` or :func:`by_regrouping`.
    """

    def record(r: FunctionBuilder) -> Program:
        meaning, links = "per link: " + ", ".join(STANDARD), r.model.links
        if r.drives:
            meaning += f"; then {drive_inertia_meaning(r.model.spec)}"
        port = Port("phi", (10 * links + r.drives,), "SI", "link frames", meaning, Role.STANDARD_PARAMETERS)
        phi = r.builder.input(port)
        beta = [*project(r, [phi[10 * i : 10 * i + 10] for i in range(links)]), *phi[10 * links :]]
        return r.builder.program(
            "base_parameters",
            [(r.beta_port("base parameters"), beta)],
            "Base parameters from the standard parameters of all links.",
            "beta = K phi",
            [f"Inertia tensors about the origin of the link frame, in its axes: {TENSOR}."],
        )

    return record


def add_payload(project: Projection) -> Recorder:
    """Make a recorder of beta_loaded (b,) = beta + K_n phi_p for a payload given in the axes of the last link frame.

    ``project`` is the method that computes K phi: :func:`through_projection` or :func:`by_regrouping`.
    """

    def record(r: FunctionBuilder) -> Program:
        mass, com, inertia = _payload_inputs(r, "the last link frame")
        beta = r.builder.input(r.beta_port("base parameters without the payload"))
        delta = [*project(r, _at_tip(r, _standard(mass, com, inertia))), *[0] * r.drives]
        return r.builder.program(
            "add_payload",
            [(r.beta_port("base parameters with the payload", name="beta_loaded"), add(beta, delta))],
            "Base parameters of the robot with a payload fixed to its last link.",
            "beta_loaded = beta + K_n phi_payload",
            [_SYMMETRIC, _NEGATIVE],
        )

    return record


def add_payload_at(project: Projection) -> Recorder:
    """Make a recorder of beta_loaded (b,) for a payload given in a frame of its own, with its pose in the last link.

    ``project`` is the method that computes K phi: :func:`through_projection` or :func:`by_regrouping`.
    """

    def record(r: FunctionBuilder) -> Program:
        mass, com, inertia = _payload_inputs(r, "the payload's frame")
        meaning = "pose of the payload's frame, a homogeneous transform"
        T = r.builder.input(Port("frame", (4, 4), "1, m", "last link frame", meaning, Role.PAYLOAD))
        beta = r.builder.input(r.beta_port("base parameters without the payload"))
        R: Matrix = [list(T[4 * i : 4 * i + 3]) for i in range(3)]
        tensor = [[inertia[min(i, j)][max(i, j)] for j in range(3)] for i in range(3)]
        com = add(times(R, com), [T[3], T[7], T[11]])
        turned = _standard(mass, com, product(product(R, tensor), transpose(R)))
        delta = [*project(r, _at_tip(r, turned)), *[0] * r.drives]
        return r.builder.program(
            "add_payload_at",
            [(r.beta_port("base parameters with the payload", name="beta_loaded"), add(beta, delta))],
            "Base parameters of the robot with a payload that is described in a frame of its own.",
            "beta_loaded = beta + K_n phi_payload",
            [_SYMMETRIC, _NEGATIVE],
        )

    return record


_SYMMETRIC = "The inertia tensor is symmetric: only its upper triangle is read."
_NEGATIVE = "A payload is taken off again by the same call with negative mass and inertia and the same centre of mass."


def _payload_inputs(r: FunctionBuilder, frame: str) -> tuple[Any, list[Any], Matrix]:
    (mass,) = r.builder.input(Port("mass", (), "kg", "", "mass of the payload", Role.PAYLOAD))
    com = r.builder.input(Port("com", (3,), "m", frame, "centre of mass of the payload", Role.PAYLOAD))
    meaning = "inertia tensor about the centre of mass"
    flat = r.builder.input(Port("inertia", (3, 3), "kg m^2", f"axes of {frame}", meaning, Role.PAYLOAD))
    return mass, list(com), [list(flat[3 * i : 3 * i + 3]) for i in range(3)]


def _at_tip(r: FunctionBuilder, phi: list[Any]) -> list[list[Any]]:
    """The standard parameters of all links, with ``phi`` (10,) for the link that carries the tip, zero for others."""
    return [phi if i == r.model.tip_link else [0] * 10 for i in range(r.model.links)]


def _standard(mass: Any, com: list[Any], inertia: Matrix) -> list[Any]:
    """The standard parameters (10,) of a body with centre of mass c = ``com`` and ``inertia`` I about it.

    The inertia about the origin is ``I + m (c . c 1 - c c')`` by Steiner's theorem.
    """
    x, y, z = com
    mx, my, mz = scale(mass, com)
    xx, yy, zz = mx * x, my * y, mz * z
    return [
        *(mass, mx, my, mz),
        *(inertia[0][0] + (yy + zz), inertia[0][1] - mx * y, inertia[1][1] + (xx + zz)),
        *(inertia[0][2] - mx * z, inertia[1][2] - my * z, inertia[2][2] + (xx + yy)),
    ]


_PROJECTIONS = (by_regrouping, through_projection)


BASE_PARAMETERS = tuple(base_parameters(project) for project in _PROJECTIONS)
ADD_PAYLOAD = tuple(add_payload(project) for project in _PROJECTIONS)
ADD_PAYLOAD_AT = tuple(add_payload_at(project) for project in _PROJECTIONS)
