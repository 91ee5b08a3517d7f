"""Second derivatives of inverse and forward dynamics, recorded from the optimized programs of these functions.

For constant weights w, one reverse sweep over a program of tau gives the gradient of ``L = w' tau(q, dq, ddq)``, at the
price of about two evaluations of tau. A forward sweep over the optimized gradient gives the Hessian

        q    Hqq  Hvq' Haq'
    H = dq   Hvq  Hvv  0         L is quadratic in dq and linear in ddq: Hav = Haa = 0,
        ddq  Haq  0    0

for which it needs the directions along q, and along dq for Hvv alone. Starting from the first derivatives of tau
instead, whose weighted sum is the gradient too, costs twice as much except for short programs, where both are tried.
The product ``H x`` is a forward sweep along the single direction x, at the price of five evaluations of tau.

Forward dynamics ``ddq(q, dq, tau)`` is an implicit function. Differentiating ``tau(q, dq, ddq(q, dq, tau)) = tau``
twice and multiplying by ``mu = inv(M) w`` gives

    d2(w' ddq) = -S' H(mu) S,    S = [1 over Z],   Z = d(ddq)/d(q, dq, tau),

with H of inverse dynamics at the solution ddq, so that nothing is derived anew. As S is a unit matrix above Z, the
blocks are, up to the sign, ``Hqq + Haq' Zq + Zq' Haq``, ``Hvq + Zv' Haq``, ``Htq = Zt' Haq`` and ``Hvv``; those of tau
and dq, and of tau and tau, are zero.

The cheaper of two ways gives dM/dq: a forward sweep over the mass matrix, or its own recursion
(:mod:`rrrgen.derive.recursions.mass_matrix_derivatives`). Since tau is quadratic in dq, its second derivatives by dq
are sums of three elements of dM/dq, twice the Christoffel symbols of the first kind:
``d2tau_i/(d dq_j d dq_k) = dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i``.
"""

from __future__ import annotations

from collections.abc import Sequence

from rrrgen.derive.functions.recording import FunctionBuilder
from rrrgen.derive.recursions import mass_matrix_derivatives as recursion
from rrrgen.derive.recursions.linear_algebra import Matrix, dot, flat, rows, status_at
from rrrgen.program import Builder, Port, Program, Role, Value, count_operations
from rrrgen.program.builder import replay
from rrrgen.program.differentiation import Tangent, jacobian, pull_back, record, tangents
from rrrgen.program.passes.cheapest import Cheapest, Choice, PassLog
from rrrgen.program.passes.equal_values import ShareEqualValues

STATE = (Role.POSITION, Role.VELOCITY, Role.ACCELERATION)
"""The inputs of inverse dynamics by which it is differentiated, in the order of the Hessian's blocks."""

SHORT = 115
"""Operations of inverse dynamics up to which the gradient is also made from the first derivatives of the torques."""


def upper_triangle_indices(n: int) -> list[tuple[int, int]]:
    """Row and column of each element of a symmetric matrix (n, n) that is stored as its upper triangle, row by row."""
    return [(i, j) for i in range(n) for j in range(i, n)]


# ------------------------------------------------------------------------------------------------------------------
# Inverse dynamics
# ------------------------------------------------------------------------------------------------------------------


def mass_matrix_derivatives(r: FunctionBuilder, mass: Program) -> Program:
    """Derive dM/dq (n, n, n) from a program of the mass matrix, along every joint, or by a recursion."""

    def finish(builder: Builder, slopes: Sequence[Value]) -> Program:
        port = Port("dM_dq", (r.n, r.n, r.n), "SI", "", "d M_ij / d q_k at [i][j][k], symmetric in i and j")
        summary = "Derivatives of the mass matrix, drive inertia included, with respect to the joint positions."
        return builder.program("mass_matrix_derivatives", [(port, slopes)], summary, "dM_ij/dq_k")

    b, inputs = _with_inputs_of(mass)
    (M,) = _along(mass, b, inputs, record(mass, b, inputs), STATE[:1])
    ways = [finish(b, [element.get(k, 0) for element in M for k in range(r.n)])]
    if mass.takes(Role.BASE_PARAMETERS) and (chain := r.chain()).loops is None:
        slopes = recursion.mass_matrix_derivatives(chain, r.inertias())
        columns = [D[i][j] for i in range(r.n) for j in range(r.n) for D in slopes]
        ways.append(finish(r.builder, columns))
    share = ShareEqualValues(sums=True)
    return cheapest_of(*ways, *(share(way) for way in ways))


def inverse_dynamics_hessian(r: FunctionBuilder, torques: Program) -> Program:
    """Derive gradient and Hessian of ``weights' tau`` from a program of inverse dynamics."""
    return cheapest_of(*(_hessian(r, gradient) for gradient in _gradients(r, torques)))


def inverse_dynamics_hessian_product(r: FunctionBuilder, torques: Program) -> Program:
    """Derive the product of the Hessian of ``weights' tau`` with a direction from a program of inverse dynamics."""
    return cheapest_of(*(_product(r, gradient) for gradient in _gradients(r, torques)))


def inverse_dynamics_second_derivatives(r: FunctionBuilder, derivatives: Program) -> Program:
    """Derive all second derivatives of the joint torques from a program of their first derivatives."""
    b, inputs = _with_inputs_of(derivatives)
    _, by_q, by_v, M = _along(derivatives, b, inputs, record(derivatives, b, inputs), STATE[:1])
    shape, n = (r.n, r.n, r.n), range(r.n)

    def dM(i: int, j: int, k: int) -> Value:
        return M[min(i, j) * r.n + max(i, j)].get(k, 0)

    def christoffel(i: int, j: int, k: int) -> Value:
        return b.sub(b.add(dM(i, j, k), dM(i, k, j)), dM(j, k, i))

    ports = [
        Port("d2tau_dqq", shape, "SI", "", "d2 tau_i / d q_j d q_k at [i][j][k], symmetric in j and k"),
        Port("d2tau_dvq", shape, "SI", "", "d2 tau_i / d dq_j d q_k"),
        Port("d2tau_dvv", shape, "SI", "", "d2 tau_i / d dq_j d dq_k, symmetric in j and k"),
        Port("dM_dq", shape, "SI", "", "d2 tau_i / d ddq_j d q_k = d M_ij / d q_k, symmetric in i and j"),
    ]
    results = [
        [by_q[i * r.n + min(j, k)].get(max(j, k), 0) for i in n for j in n for k in n],
        [by_v[i * r.n + j].get(k, 0) for i in n for j in n for k in n],
        [christoffel(i, min(j, k), max(j, k)) for i in n for j in n for k in n],
        [dM(i, j, k) for i in n for j in n for k in n],
    ]
    return cheapest_of(
        b.program(
            "inverse_dynamics_second_derivatives",
            list(zip(ports, results, strict=True)),
            "All second derivatives of the joint torques that can differ from zero.",
            "d2tau_i/(dx_j dy_k) for x, y = q, dq, ddq; those by ddq and dq, and by ddq and ddq, are zero",
        )
    )


def _gradients(r: FunctionBuilder, torques: Program) -> list[Program]:
    """Optimized programs of the gradient (3 n) of ``weights' tau`` with respect to q, dq and ddq, to start from."""
    b, inputs = _with_inputs_of(torques)
    weights = b.input(r.port("weights"))
    gradients = pull_back(torques, b, record(torques, b, inputs), [weights])
    by_role = {port.role: row for port, row in zip(torques.inputs, gradients, strict=True)}
    ways = [_gradient(r, b, [value for role in STATE for value in by_role[role]])]
    if count_operations(torques).total <= SHORT:
        names = [next(port.name for port in torques.inputs if port.role is role) for role in STATE]
        derivatives = cheapest_of(jacobian(torques, "tau", names))
        b, inputs = _with_inputs_of(derivatives)
        weights = b.input(r.port("weights"))
        blocks = replay(derivatives, b, inputs)[1:]
        ways.append(_gradient(r, b, [dot(weights, block[j :: r.n]) for block in blocks for j in range(r.n)]))
    return [cheapest_of(way) for way in ways]


def _gradient(r: FunctionBuilder, b: Builder, slopes: Sequence[Value]) -> Program:
    return b.program("gradient", [(_gradient_port(r, "tau", "(q, dq, ddq)"), slopes)])


def _hessian(r: FunctionBuilder, gradient: Program) -> Program:
    """The program ``inverse_dynamics_hessian``, by a forward sweep over the ``gradient``.

    Of Hqq the upper triangle is computed, of Hvv the lower one: the other would take 7 % and 1 to 3 % more operations.
    """
    b, inputs = _with_inputs_of(gradient)
    values, n = record(gradient, b, inputs), r.n
    (slopes,) = _along(gradient, b, inputs, values, STATE[:2])
    full = [(i, j) for i in range(n) for j in range(n)]
    results = [
        [slopes[i].get(j, 0) for i, j in upper_triangle_indices(n)],
        [slopes[n + i].get(j, 0) for i, j in full],
        [slopes[2 * n + i].get(j, 0) for i, j in full],
        [slopes[n + j].get(n + i, 0) for i, j in upper_triangle_indices(n)],
    ]
    first = [values[index] for index in gradient.results[0]]
    return b.program(
        "inverse_dynamics_hessian",
        [(gradient.outputs[0], first), *zip(_blocks(r, "tau", "ddq"), results, strict=True)],
        "Gradient and Hessian of a weighted sum of the joint torques, for given weights.",
        "d(weights' tau) = gradient' dx + dx' H dx / 2,  x = (q, dq, ddq)",
        [_storage("a", "ddq")],
    )


def _product(r: FunctionBuilder, gradient: Program) -> Program:
    """The program ``inverse_dynamics_hessian_product``, by a forward sweep over the ``gradient``."""
    b, inputs = _with_inputs_of(gradient)
    direction = b.input(r.port("direction"))
    (slopes,) = _along(gradient, b, inputs, record(gradient, b, inputs), STATE, direction)
    port = Port("product", (3 * r.n,), "SI", "", "H direction, H the Hessian of weights' tau by (q, dq, ddq)")
    return b.program(
        "inverse_dynamics_hessian_product",
        [(port, [slope.get(0, 0) for slope in slopes])],
        "Product of the Hessian of a weighted sum of the joint torques with a direction.",
        "product = d2(weights' tau)/d(q, dq, ddq)2 direction",
    )


# ------------------------------------------------------------------------------------------------------------------
# Forward dynamics
# ------------------------------------------------------------------------------------------------------------------


def forward_dynamics_hessian(r: FunctionBuilder, hessian: Program, derivatives: Program) -> Program:
    """Record gradient and Hessian of ``weights' ddq`` from the programs that the module names.

    ``hessian`` is that of inverse dynamics, ``derivatives`` are the first derivatives of forward dynamics. All results
    are zero where M is not positive definite.
    """
    _, _, _, weights = (r.joints(name) for name in ("q", "dq", "tau", "weights"))
    if derivatives.takes(Role.GRAVITY):
        r.gravity()
    if derivatives.takes(Role.BASE_PARAMETERS):
        r.beta()
    n, values = r.n, replay(derivatives, r.builder, r.inputs_of(derivatives))
    ddq, (status,) = values[0], values[4]
    Zq, Zv, Zt = (rows(n, block) for block in values[1:4])
    mu = [dot(row, weights) for row in Zt]  # Zt is inv(M), symmetric
    solution = r.inputs_of(hessian, {Role.ACCELERATION: ddq, Role.COVECTOR: mu})
    _, qq, vq, aq, vv = replay(hessian, r.builder, solution)
    columns = list(zip(*rows(n, aq), strict=True))

    def times(Z: Matrix) -> Matrix:
        """The matrix Z' Haq."""
        return [[dot(z, column) for column in columns] for z in zip(*Z, strict=True)]

    turned = times(Zq)
    negative = [
        [h + turned[i][j] + turned[j][i] for h, (i, j) in zip(qq, upper_triangle_indices(n), strict=True)],
        [h + z for h, z in zip(vq, flat(times(Zv)), strict=True)],
        flat(times(Zt)),
        vv,
    ]
    gradient = [dot(column, weights) for Z in (Zq, Zv, Zt) for column in zip(*Z, strict=True)]
    ports = [
        (_gradient_port(r, "ddq", "(q, dq, tau)"), gradient),
        *zip(_blocks(r, "ddq", "tau"), [[-value for value in block] for block in negative], strict=True),
        (Port("status", (), "1"), [status]),
    ]
    return r.builder.program(
        "forward_dynamics_hessian",
        ports,
        "Gradient and Hessian of a weighted sum of the joint accelerations, for given weights.",
        "d2(weights' ddq) = -S' H S with H of inverse dynamics for inv(M) weights, S = [1 over d ddq/d(q, dq, tau)]",
        [_storage("t", "tau"), "All outputs are zero when M is not positive definite."],
        status_at(len(ports) - 1),
    )


# ------------------------------------------------------------------------------------------------------------------
# What both share
# ------------------------------------------------------------------------------------------------------------------


def _gradient_port(r: FunctionBuilder, of: str, by: str) -> Port:
    return Port("gradient", (3 * r.n,), "SI", "", f"d(weights' {of}) / d{by}")


def _blocks(r: FunctionBuilder, of: str, last: str) -> tuple[Port, ...]:
    """The outputs with the blocks of the Hessian of ``weights' of``, whose third argument is ``last``."""
    n, half, letter = r.n, r.n * (r.n + 1) // 2, "a" if last == "ddq" else "t"

    def meaning(x: str, y: str) -> str:
        return f"d2(weights' {of}) / d {x}_i d {y}_j"

    return (
        Port("Hqq", (half,), "SI", "", meaning("q", "q") + ", i <= j"),
        Port("Hvq", (n, n), "SI", "", meaning("dq", "q")),
        Port(f"H{letter}q", (n, n), "SI", "", meaning(last, "q")),
        Port("Hvv", (half,), "SI", "", meaning("dq", "dq") + ", i <= j"),
    )


def _storage(letter: str, last: str) -> str:
    """The note on how the Hessian is stored, whose blocks of the third argument ``last`` have this ``letter``."""
    return (
        f"Of the symmetric Hqq and Hvv there is the upper triangle, row by row. Hvq has a row for each dq, H{letter}q "
        f"for each {last}, both have a column for each q. H{letter}v = H{letter}{letter} = 0."
    )


def cheapest_of(*ways: Program) -> Program:
    """The cheapest of equivalent programs, with equal values computed once."""
    cheapest, log = Cheapest(), PassLog()
    best, _ = cheapest(ways, ways[0].name, log)
    shared = ShareEqualValues()(best)
    return best if shared is best else cheapest([shared], best.name, log, [Choice(0, None)])[0]


def _with_inputs_of(program: Program) -> tuple[Builder, list[Sequence[Value]]]:
    """A new builder that has the inputs of ``program``, and their elements."""
    builder = Builder()
    return builder, [builder.input(port) for port in program.inputs]


def _along(
    program: Program,
    builder: Builder,
    inputs: Sequence[Sequence[Value]],
    values: Sequence[Value],
    roles: Sequence[Role],
    direction: Sequence[Value] | None = None,
) -> list[list[Tangent]]:
    """The tangents of all outputs of ``program`` along every element of the inputs with these ``roles``.

    The elements are numbered through all these inputs in the order of ``roles``. With a ``direction``, which has a
    value for each of them, it is along this single direction, number 0.
    """
    seeds: list[list[Tangent]] = [[{} for _ in elements] for elements in inputs]
    count = 0
    for role in roles:
        k = next(k for k, port in enumerate(program.inputs) if port.role is role)
        places = range(count, count + len(inputs[k]))
        seeds[k] = [{place: 1} if direction is None else {0: direction[place]} for place in places]
        count += len(inputs[k])
    return tangents(program, builder, values, seeds, rotations=direction is not None)
