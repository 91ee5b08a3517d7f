"""Second derivatives of inverse dynamics on a floating base, recorded from its program for sensors of the base.

For constant weights w (6 + n,) of the wrench on the base and the torques, ``L = w' [wrench; tau]`` depends on

    x = (p, xi, q),   v = (twist, dq),   a = (twist_rate, ddq)

with the translation p and the rotation xi of the base along and about its own axes: its orientation R becomes
``R exp([xi]x)``. The program takes the angular velocity omega of the base, its rate, and what an accelerometer at the
base origin measures, ``s = dv/dt + omega x v - R' g``. It is affine in s: ``F = dL/ds`` depends on q alone. With the
weight ``g_b = R' g``, of which ``d(g_b) = g_b x d xi``, one reverse sweep thus gives the gradient of L,

    dL/dp = 0,   dL/dxi = g_b x F,   dL/d(dv/dt) = F,   dL/dv = F x omega,   dL/domega = (its own part) + v x F,

and those by the joints. A forward sweep over the optimized gradient, along xi and q, and along twist and dq for the
block of the velocities, gives the Hessian. Differentiating ``g_b x F`` along xi once more gives repeated derivatives on
the group of rotations, ``(g_b x e_j) x F``, which are not symmetric. The Hessian is that of L along the exponential
map, of which ``R' g`` has the second derivative

    (e_i x (e_j x g_b) + e_j x (e_i x g_b)) / 2:

the symmetric part, which is the repeated derivative plus half the vector product of e_j and dL/dxi. Blocks that vanish
are not computed: nothing depends on p; xi enters only through g_b, which multiplies functions of q; L is linear in a.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

from rrrgen.derive.functions.floating_base import NO_UNIT, STATUS, in_base_axes, status_of
from rrrgen.derive.functions.recording import FunctionBuilder
from rrrgen.derive.functions.second_derivatives import cheapest_of, upper_triangle_indices
from rrrgen.derive.recursions.linear_algebra import Vector, add, cross, subtract
from rrrgen.program import Builder, Port, Program, Role, Status, Value
from rrrgen.program.differentiation import Tangent, is_zero, pull_back, record, tangents

AXES = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
MOTION = ("q", "dq", "ddq", "twist", "twist_rate")
WEIGHT = Port("weight", (3,), "m/s^2", "base", "acceleration of gravity in base axes")
OF_WHAT = "f = [wrench; tau], x = (translation, rotation of the base, q), v = (twist, dq), a = (twist_rate, ddq)"
ALONG = "A rotation xi of the base turns its orientation R to R exp([xi]x): H is that along the exponential map."


def inverse_dynamics_hessian(r: FunctionBuilder, forces: Program) -> Program:
    """Derive gradient and Hessian of ``weights' [wrench; tau]`` from the program with the sensors of the base."""
    return cheapest_of(_hessian(r, weighted_gradient(r, forces)))


def inverse_dynamics_hessian_product(r: FunctionBuilder, forces: Program) -> Program:
    """Derive the product of that Hessian with a direction from the program with the sensors of the base."""
    return cheapest_of(_product(r, weighted_gradient(r, forces)))


def weighted_gradient(r: FunctionBuilder, forces: Program) -> Program:
    """The optimized program of the gradient (15 + 3 n), without the translation, with the weight R' g as an input.

    Its elements belong to rotation of the base, q, twist, dq, twist_rate and ddq.
    """
    b = Builder()
    given: dict[str, Sequence[Value]] = {name: b.input(r.port(name)) for name in MOTION}
    weights, weight = b.input(_weights_port(r)), b.input(WEIGHT)
    given |= {port.name: b.input(port) for port in forces.inputs if port.role is Role.BASE_PARAMETERS}
    (v, omega), (v_rate, omega_rate) = ((given[name][:3], given[name][3:]) for name in ("twist", "twist_rate"))
    accelerometer = subtract(add(v_rate, cross(omega, v)), weight)
    known = given | {"gyro": omega, "gyro_rate": omega_rate, "accelerometer": accelerometer}
    inputs = [known[port.name] for port in forces.inputs]
    gradients = pull_back(forces, b, record(forces, b, inputs), [weights[:6], weights[6:]])
    by = {port.name: slopes for port, slopes in zip(forces.inputs, gradients, strict=True)}
    F = by["accelerometer"]
    slopes = [
        *cross(weight, F),
        *by["q"],
        *cross(F, omega),
        *add(by["gyro"], cross(v, F)),
        *by["dq"],
        *F,
        *by["gyro_rate"],
        *by["ddq"],
    ]
    port = Port("gradient", (15 + 3 * r.n,), "SI", "", "by rotation of the base, q, twist, dq, twist_rate and ddq")
    return cheapest_of(b.program("gradient", [(port, slopes)]))


class _Swept:
    """The gradient recorded in the function ``r`` with its orientation, and its tangents along given directions."""

    def __init__(self, r: FunctionBuilder, gradient: Program) -> None:
        self._program, self._b = gradient, r.builder
        gravity = r.chain_in_gravity("dq", "ddq").gravity
        known: dict[str, Sequence[Value]] = {name: r.joints(name) for name in ("q", "dq", "ddq")}
        known |= {name: r.on_base(name) for name in ("twist", "twist_rate")}
        known["weights"] = r.builder.input(_weights_port(r))
        self._weight = known["weight"] = in_base_axes(r.on_base("orientation"), gravity)
        if gradient.takes(Role.BASE_PARAMETERS):
            known["beta"] = r.beta()
        self._values = record(gradient, r.builder, [known[port.name] for port in gradient.inputs])
        self.gradient = [self._values[index] for index in gradient.results[0]]
        self.of_rotation = self.gradient[:3]
        self.status = status_of(r)

    def along(
        self, rotation: Sequence[Mapping[int, Value]], seeds: Mapping[str, Sequence[Tangent]], one: bool = False
    ) -> list[Tangent]:
        """The tangents of the gradient, for those of the ``rotation`` of the base (3,) and of inputs by name.

        ``one``: along the single direction 0, in which all inputs may change.
        """
        directions = sorted({d for tangent in rotation for d in tangent})
        moved: list[Tangent] = [{}, {}, {}]
        for d in directions:
            for k, value in enumerate(cross(self._weight, [tangent.get(d, 0) for tangent in rotation])):
                if not is_zero(value):
                    moved[k][d] = value
        every = {**seeds, WEIGHT.name: moved}
        asked = [every.get(port.name, [{} for _ in range(port.size)]) for port in self._program.inputs]
        return tangents(self._program, self._b, self._values, asked, rotations=one)[0]

    def symmetric(self, direction: Sequence[Any]) -> Vector:
        """What the second derivative by the rotation has along ``direction`` (3,) besides the repeated derivative."""
        return [Fraction(1, 2) * x if not is_zero(x) else 0 for x in cross(list(direction), self.of_rotation)]


def _hessian(r: FunctionBuilder, gradient: Program) -> Program:
    """The program ``floating_inverse_dynamics_hessian``, by a forward sweep over the ``gradient``."""
    swept, n = _Swept(r, gradient), r.n
    moved, size = 3 + n, 6 + n
    seeds: dict[str, list[Tangent]] = {
        "q": [{3 + k: 1} for k in range(n)],
        "twist": [{moved + k: 1} for k in range(6)],
        "dq": [{moved + 6 + k: 1} for k in range(n)],
    }
    slopes = swept.along([{k: 1} for k in range(3)], seeds)
    further = [swept.symmetric(axis) for axis in AXES]

    def by_pose(i: int, j: int) -> Value:
        slope = slopes[i].get(j, 0)
        return r.builder.add(slope, further[j][i]) if j < 3 else slope

    results = [
        [by_pose(i, j) for i, j in upper_triangle_indices(moved)],
        [slopes[moved + i].get(3 + j, 0) for i in range(size) for j in range(n)],
        [slopes[moved + size + i].get(3 + j, 0) for i in range(size) for j in range(n)],
        [slopes[moved + i].get(moved + j, 0) for i, j in upper_triangle_indices(size)],
    ]
    port = Port("gradient", (3 * size,), "SI", "", "d(weights' f) by (x, v, a); the translation's elements are zero")
    ports = [
        (port, [0, 0, 0, *swept.gradient]),
        *zip(_blocks(n), results, strict=True),
        (STATUS, [swept.status]),
    ]
    return r.builder.program(
        "floating_inverse_dynamics_hessian",
        ports,
        "Gradient and Hessian of a weighted sum of the wrench on a floating base and the joint torques.",
        f"d(weights' f) = gradient' dz + dz' H dz / 2,  z = (x, v, a),  {OF_WHAT}",
        [
            f"{ALONG} Hxx has the rotation of the base, then q; Hvv the twist, then dq; of both there is the upper "
            "triangle, row by row. Hvq has a row for each of v, Haq for each of a, both have a column for each q. All "
            "other elements are zero: those of the translation, of the rotation with v and a, of a with v and a."
        ],
        Status(len(ports) - 1, (NO_UNIT,)),
    )


def _product(r: FunctionBuilder, gradient: Program) -> Program:
    """The program ``floating_inverse_dynamics_hessian_product``, by a forward sweep over the ``gradient``."""
    swept, n = _Swept(r, gradient), r.n
    direction, size = r.builder.input(r.port("direction")), 6 + n
    rotation = direction[3:6]
    parts = {"q": direction[6:size], "twist": direction[size : size + 6], "dq": direction[size + 6 : 2 * size]}
    parts |= {"twist_rate": direction[2 * size : 2 * size + 6], "ddq": direction[2 * size + 6 :]}
    seeds: dict[str, list[Tangent]] = {name: [{0: value} for value in part] for name, part in parts.items()}
    slopes = swept.along([{0: value} for value in rotation], seeds, one=True)
    product = [slope.get(0, 0) for slope in slopes]
    product[:3] = [r.builder.add(x, y) for x, y in zip(product[:3], swept.symmetric(rotation), strict=True)]
    port = Port("product", (3 * size,), "SI", "", "H direction, H the Hessian of weights' f by (x, v, a)")
    return r.builder.program(
        "floating_inverse_dynamics_hessian_product",
        [(port, [0, 0, 0, *product]), (STATUS, [swept.status])],
        "Product of the Hessian of a weighted sum of the wrench on a floating base and the torques with a direction.",
        f"product = d2(weights' f)/d(x, v, a)2 direction,  {OF_WHAT}",
        [f"{ALONG} The elements of the translation are zero, and those of the direction are not read."],
        Status(1, (NO_UNIT,)),
    )


def _weights_port(r: FunctionBuilder) -> Port:
    """The port of the weights (6 + n,), which are no joint vector."""
    port = r.port("weights")
    return Port(port.name, port.shape, port.unit, "", port.meaning)


def _blocks(n: int) -> tuple[Port, ...]:
    """The outputs with the blocks of the Hessian that can differ from zero."""
    moved, size = 3 + n, 6 + n

    def meaning(one: str, other: str) -> str:
        return f"d2(weights' f) / d {one}_i d {other}_j"

    return (
        Port("Hxx", (moved * (moved + 1) // 2,), "SI", "", "d2(weights' f) by rotation of the base and q, i <= j"),
        Port("Hvq", (size, n), "SI", "", meaning("v", "q")),
        Port("Haq", (size, n), "SI", "", meaning("a", "q")),
        Port("Hvv", (size * (size + 1) // 2,), "SI", "", meaning("v", "v") + ", i <= j"),
    )
