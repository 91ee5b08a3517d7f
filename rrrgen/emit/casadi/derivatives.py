"""Derivatives of programs with CasADi's signatures: Jacobian, one forward direction, one reverse direction.

CasADi looks up the derivatives of an external function ``f`` by name and calls them with fixed signatures:

- ``jac_f(inputs, out_*)`` returns the blocks d vec(output) / d vec(input), output by output, sparse;
- ``fwd1_f(inputs, out_*, fwd_inputs)`` returns J v, one ``fwd_*`` per output;
- ``adj1_f(inputs, out_*, adj_outputs)`` returns J' w, one ``adj_*`` per input;

where ``out_*`` are the outputs of ``f``, which an implementation may reuse (this one does not: they have no nonzeros).
The transformations take and return a :class:`Routine`, so they nest: ``fwd1_adj1_f`` gives Hessian-vector products.

Differentiation works on the program's nodes (:mod:`rrrgen.program.differentiation`); zeros known while recording never
become operations, so Jacobians come out with their structural sparsity.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import cast

from rrrgen.program import Builder, Port, Program, Scalar, Value
from rrrgen.program.builder import replay
from rrrgen.program.differentiation import Tangent, is_zero, pull_back, record, tangents
from rrrgen.program.program import Node

ROWS_FACTOR = 4
"""Approximate cost of one reverse sweep, in units of one direction of a forward sweep over several directions."""


@dataclass(frozen=True)
class Matrix:
    """An argument or a result of a routine: a ``rows`` x ``cols`` matrix with the nonzeros ``entries``.

    ``entries`` lists (row, column) in the order of compressed columns, which is the order of the scalars in the port of
    the same name.
    """

    name: str
    rows: int
    cols: int
    entries: tuple[tuple[int, int], ...]

    @classmethod
    def dense(cls, name: str, rows: int, cols: int) -> Matrix:
        """Make a ``rows`` x ``cols`` matrix without structural zeros."""
        return cls(name, rows, cols, tuple((r, c) for c in range(cols) for r in range(rows)))

    @property
    def is_dense(self) -> bool:
        """Whether every entry is a nonzero."""
        return len(self.entries) == self.rows * self.cols

    def empty(self, prefix: str) -> Matrix:
        """A matrix of the same size without nonzeros, its name preceded by ``prefix``."""
        return Matrix(prefix + self.name, self.rows, self.cols, ())

    def with_prefix(self, prefix: str) -> Matrix:
        """The matrix with the same pattern of nonzeros, its name preceded by ``prefix``."""
        return Matrix(prefix + self.name, self.rows, self.cols, self.entries)


@dataclass(frozen=True)
class Routine:
    """A function of sparse matrices, ``inputs`` -> ``outputs``, and the program that computes it.

    Each port of the program holds the nonzeros of one of the matrices, ordered by columns.
    """

    name: str
    program: Program
    inputs: tuple[Matrix, ...]
    outputs: tuple[Matrix, ...]


def input_place(node: Node) -> tuple[int, int]:
    """Port and element that an input node reads."""
    port, element = cast("tuple[int, int]", node.value)
    return port, element


def matrix_size(port: Port) -> tuple[int, int]:
    """Rows and columns of a port as a CasADi matrix: () is 1 x 1, (n,) n x 1, (m, n) m x n, (k, m, n) k*m x n."""
    if len(port.shape) < 2:
        return port.size, 1
    cols = port.shape[-1]
    return (port.size // cols if cols else 0), cols


def row_major_place(rows: int, cols: int) -> list[int]:
    """Row-major index of each entry in column-major order."""
    return [r * cols + c for c in range(cols) for r in range(rows)]


def routine(program: Program, name: str) -> Routine:
    """Convert ``program`` to a routine with dense matrices in column-major order, which is CasADi's.

    Raises InternalError if the program is malformed.
    """
    program.validate()
    builder = Builder()
    inputs = [Matrix.dense(port.name, *matrix_size(port)) for port in program.inputs]
    outputs = [Matrix.dense(port.name, *matrix_size(port)) for port in program.outputs]
    values: list[list[Value]] = []
    for matrix, elements in zip(inputs, _declare(builder, inputs), strict=True):
        by_rows: list[Value] = [0] * len(elements)
        for element, place in zip(elements, row_major_place(matrix.rows, matrix.cols), strict=True):
            by_rows[place] = element
        values.append(by_rows)
    results = replay(program, builder, values)
    ordered = [
        [row[place] for place in row_major_place(matrix.rows, matrix.cols)]
        for matrix, row in zip(outputs, results, strict=True)
    ]
    return _finish(builder, name, inputs, outputs, ordered, program.summary)


def jacobian(base: Routine) -> Routine:
    """The sparse blocks d vec(output) / d vec(input), for every output (outer) and input (inner).

    Computed by columns in forward mode, or by rows in reverse mode if there are few outputs.
    """
    builder = Builder()
    inputs = [*base.inputs, *(m.empty("out_") for m in base.outputs)]
    values = _declare(builder, inputs)[: len(base.inputs)]
    count = sum(len(m.entries) for m in base.inputs)
    by_rows = ROWS_FACTOR * sum(len(m.entries) for m in base.outputs) < count
    return _jacobian(base, builder, inputs, (_rows if by_rows else _columns)(base, builder, values))


def _jacobian(
    base: Routine, builder: Builder, inputs: Sequence[Matrix], gradients: Sequence[Sequence[Tangent]]
) -> Routine:
    """The Jacobian of ``base``, from the gradient of every entry of every output, by places in all inputs together."""
    outputs, results = [], []
    for out, row in zip(base.outputs, gradients, strict=True):
        offset = 0
        for source in base.inputs:
            matrix, nonzeros = _block(out, row, source, offset)
            outputs.append(matrix)
            results.append(nonzeros)
            offset += len(source.entries)
    return _finish(builder, f"jac_{base.name}", inputs, outputs, results, f"Jacobian of {base.name}.")


def _columns(base: Routine, builder: Builder, values: Sequence[Sequence[Value]]) -> list[list[Tangent]]:
    """Gradients of all outputs by one sparse forward sweep; the inputs of all ports are numbered consecutively."""
    seeds: list[list[Tangent]] = []
    count = 0
    for row in values:
        seeds.append([{count + k: 1} for k in range(len(row))])
        count += len(row)
    return tangents(base.program, builder, record(base.program, builder, values), seeds)


def _rows(base: Routine, builder: Builder, values: Sequence[Sequence[Value]]) -> list[list[Tangent]]:
    """Gradients of all outputs by one reverse sweep each."""
    recorded = record(base.program, builder, values)
    gradients: list[list[Tangent]] = []
    for k, out in enumerate(base.outputs):
        gradients.append([])
        for element in range(len(out.entries)):
            weights: list[list[Value]] = [[0] * len(m.entries) for m in base.outputs]
            weights[k][element] = 1
            flat = [v for row in pull_back(base.program, builder, recorded, weights) for v in row]
            gradients[-1].append(_without_zeros(flat))
    return gradients


def _block(out: Matrix, row: Sequence[Tangent], source: Matrix, offset: int) -> tuple[Matrix, list[Value]]:
    """Make the block d vec(out) / d vec(source) of the sparse Jacobian: (pattern of nonzeros, their values by columns).

    ``row`` holds the gradient of every entry of ``out``; the entries of ``source`` have numbers from ``offset`` on in
    these gradients.
    """
    entries, elements = [], []
    for column, (r, c) in enumerate(source.entries):
        for (i, j), tangent in zip(out.entries, row, strict=True):
            if offset + column in tangent:
                entries.append((j * out.rows + i, c * source.rows + r))
                elements.append(tangent[offset + column])
    size = (out.rows * out.cols, source.rows * source.cols)
    return Matrix(f"jac_{out.name}_{source.name}", *size, tuple(entries)), elements


def jacobian_from(base: Routine, first: Program) -> Routine:
    """The Jacobian of ``base``, y(x1, x2, x3) and perhaps a status, from a program of y and dy/dx1, dy/dx2, dy/dx3."""
    builder, inputs, by_name = _declared_by_name(base)
    slopes = replay(first, builder, [by_name[port.name] for port in first.inputs])[1:4]
    n = len(base.outputs[0].entries)
    gradients = [_without_zeros(value for block in slopes for value in block[i * n : (i + 1) * n]) for i in range(n)]
    return _jacobian(base, builder, inputs, [gradients, *([{}] for _ in base.outputs[1:])])


def hessian_from(base: Routine, adjoint: Routine, first: Program, second: Program) -> Routine:
    """The Jacobian of ``adjoint``, the reverse derivative of ``base``, which is the Hessian of ``weights' y``.

    ``first`` is as for :func:`jacobian_from`; ``second`` computes gradient and Hessian in the blocks of
    :mod:`rrrgen.derive.functions.second_derivatives`.
    """
    builder, inputs, by_name = _declared_by_name(adjoint)
    by_name["weights"] = by_name[f"adj_{base.outputs[0].name}"]
    slopes = replay(first, builder, [by_name[port.name] for port in first.inputs])[1:4]
    Hqq, Hvq, Haq, Hvv = replay(second, builder, [by_name[port.name] for port in second.inputs])[1:5]
    n = len(by_name["weights"])
    rows: list[list[Value]] = [[0] * (4 * n) for _ in range(3 * n)]
    upper = [(i, j) for i in range(n) for j in range(i, n)]
    for (i, j), q, v in zip(upper, Hqq, Hvv, strict=True):
        rows[i][j] = rows[j][i] = q
        rows[n + i][n + j] = rows[n + j][n + i] = v
    for start, block in ((n, Hvq), (2 * n, Haq)):
        for k, value in enumerate(block):
            rows[start + k // n][k % n] = rows[k % n][start + k // n] = value
    for start, block in zip((0, n, 2 * n), slopes, strict=True):
        for k, value in enumerate(block):
            rows[start + k % n][3 * n + k // n] = value
    gradients = [[_without_zeros(row) for row in rows[k * n : (k + 1) * n]] for k in range(3)]
    return _jacobian(adjoint, builder, inputs, gradients)


def _declared_by_name(base: Routine) -> tuple[Builder, list[Matrix], dict[str, list[Scalar]]]:
    """A builder with the inputs of the Jacobian of ``base``, these inputs, and their elements by name."""
    builder = Builder()
    inputs = [*base.inputs, *(m.empty("out_") for m in base.outputs)]
    return builder, inputs, dict(zip((m.name for m in inputs), _declare(builder, inputs), strict=True))


def _without_zeros(row: Iterable[Value]) -> Tangent:
    return {place: value for place, value in enumerate(row) if not is_zero(value)}


def forward(base: Routine) -> Routine:
    """The routine of the directional derivative J v, for one vector v."""
    builder = Builder()
    seeds = [m.with_prefix("fwd_") for m in base.inputs]
    inputs = [*base.inputs, *(m.empty("out_") for m in base.outputs), *seeds]
    declared = _declare(builder, inputs)
    directions: list[list[Tangent]] = [[{0: v} for v in row] for row in declared[len(inputs) - len(seeds) :]]
    recorded = record(base.program, builder, declared[: len(base.inputs)])
    tangent_rows = tangents(base.program, builder, recorded, directions)
    results: list[list[Value]] = [[tangent.get(0, 0) for tangent in row] for row in tangent_rows]
    outputs = [m.with_prefix("fwd_") for m in base.outputs]
    return _finish(builder, f"fwd1_{base.name}", inputs, outputs, results, f"Forward derivative of {base.name}.")


def reverse(base: Routine) -> Routine:
    """The routine of the adjoint derivative J' w, for one vector w."""
    builder = Builder()
    seeds = [m.with_prefix("adj_") for m in base.outputs]
    inputs = [*base.inputs, *(m.empty("out_") for m in base.outputs), *seeds]
    declared = _declare(builder, inputs)
    weights = declared[len(declared) - len(seeds) :]
    recorded = record(base.program, builder, declared[: len(base.inputs)])
    results = pull_back(base.program, builder, recorded, weights)
    outputs = [m.with_prefix("adj_") for m in base.inputs]
    return _finish(builder, f"adj1_{base.name}", inputs, outputs, results, f"Reverse derivative of {base.name}.")


def _declare(builder: Builder, matrices: Sequence[Matrix]) -> list[list[Scalar]]:
    return [builder.input(Port(m.name, (len(m.entries),))) for m in matrices]


def _finish(
    builder: Builder,
    name: str,
    inputs: Sequence[Matrix],
    outputs: Sequence[Matrix],
    results: Sequence[Sequence[Value]],
    summary: str,
) -> Routine:
    ports = [Port(m.name, (len(m.entries),)) for m in outputs]
    program = builder.program(name, zip(ports, results, strict=True), summary=summary)
    return Routine(name, program, tuple(inputs), tuple(outputs))
