"""Closed forms: the formula of a function, with intermediate results expanded and terms in sums of angles collected.

A function is recorded again with the geometry as symbols and expanded into polynomials in sines and cosines. The angles
of parallel axes are recorded as sums, so terms in cos(q2 + q3) collect without trigonometric identities. Single entries
can be expanded alone, for robots whose whole matrices would fill pages.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any

import sympy as sp

from rrrgen.base.errors import DerivationError
from rrrgen.derive.closed_forms.decimals import with_decimals
from rrrgen.derive.closed_forms.fourier_form import shorter_form
from rrrgen.derive.closed_forms.shared_form import SharedForm, shared_form
from rrrgen.derive.derived_model import Derivation
from rrrgen.derive.functions.recording import Recording
from rrrgen.derive.functions.table import TABLE, recorders
from rrrgen.derive.recursions.link_frames import exact_constants, joint_symbols
from rrrgen.program import Op, Program, Role, Value
from rrrgen.program.nodes import reachable
from rrrgen.program.polynomials import Polynomial, PolynomialRing, to_expression
from rrrgen.robot.model.drive_terms import inertia_terms

CLOSED = tuple(f.name for f in TABLE if f.group == "model" and not f.name.startswith("forward_dynamics"))
"""Functions that are polynomials in sines and cosines: all that do not divide by the pivots of M."""

TERMS_PER_NODE = 1.25
"""Expanded forms of more terms than this times the program's nodes are shown with named intermediate results instead.

A SCARA's M, 99 terms from 93 nodes, fits in a few lines when expanded. A Panda's gravity torques, 153 terms from 108
nodes, read better as a recursion from the last link to the first; its M would have 7106 terms from 428 nodes, 1600
lines that take a minute, and takes 130 lines as a recursion.
"""

LONGEST_SHOWN = 200
"""Largest number of nodes of a program whose formula notebooks display: the regressor of an RRR arm has 159; the mass
matrix of a Puma, whose formula fills pages, has 305."""


class ClosedForm:
    """The closed form of one function: ``form[i, j]`` (from 0) is one entry, ``form.matrix()`` all of them.

    ``shape`` is the shape of the output. Entries are exact SymPy expressions in q1, dq1, ddq1, ..., base parameters and
    named parameters, in the units of the function. Where the whole is printed, ``print(form)`` or as mathematics in a
    notebook, numbers are decimals as the robot file has them; a single entry is SymPy's, which prints 9.81 as 981/100.

    Args:
        program: the function as recorded, with the geometry as inputs.
        output: the number of the output that is meant.
        generators: the expressions that the geometry inputs stand for: named parameters, and sines and cosines of
            constant angles.
        roots: the square roots among ``generators``.
        parameters: the names of the elements of each vector of parameters, by the role of its port.
        pairs: the cosine and sine of each constant angle among ``generators``.
    """

    def __init__(
        self,
        program: Program,
        output: int,
        generators: Sequence[sp.Expr],
        roots: Sequence[sp.Expr],
        parameters: Mapping[Role, Sequence[str]],
        pairs: Sequence[tuple[sp.Expr, sp.Expr]],
    ) -> None:
        self.program = program
        self._inputs = _input_symbols(program, generators, parameters)
        self._expander = _Expander(program, self._inputs, pairs, roots)
        self._nodes = program.results[output]
        self.shape: tuple[int, ...] = program.outputs[output].shape
        self.name = program.name if len(program.outputs) == 1 else f"{program.name}.{program.outputs[output].name}"

    def __getitem__(self, index: int | tuple[int, ...]) -> sp.Expr:
        """The entry at ``index`` (from 0), collected by parameters and rates. Raises IndexError outside the shape."""
        return self._expander.expression(self._nodes[self._flat((index,) if isinstance(index, int) else tuple(index))])

    def _flat(self, place: tuple[int, ...]) -> int:
        """The position of the entry at ``place`` in the row-major list of entries. Raises IndexError."""
        index = place[0] if len(place) == 1 else place
        if len(place) != len(self.shape):
            raise IndexError(f"{self.program.name} has shape {self.shape}, got index {index}")
        flat = 0
        for k, size in zip(place, self.shape, strict=True):
            if not -size <= k < size:
                raise IndexError(f"{self.program.name} has shape {self.shape}, got index {index}")
            flat = flat * size + k % size
        return flat

    def __repr__(self) -> str:
        use = "print it, index it for an entry, or take its matrix()"
        return f"<closed form of {self.name}, shape {self.shape}: {use}>"

    def __str__(self) -> str:
        """One line for each entry, indices from 0; only the name and shape if the lines would fill pages."""
        if len(self.program.nodes) > LONGEST_SHOWN:
            return repr(self)
        places = [list(place) for place in product(*map(range, self.shape))]
        return "\n".join(
            f"{self.name}{place or ''} = {sp.sstr(with_decimals(entry), full_prec=False)}"
            for place, entry in zip(places, self, strict=True)
        )

    def _repr_latex_(self) -> str | None:
        """The matrix for display in notebooks; None if it would fill pages."""
        if len(self.program.nodes) > LONGEST_SHOWN:
            return None
        return f"$\\displaystyle {sp.latex(self.matrix().applyfunc(with_decimals))}$"

    def __iter__(self) -> Iterator[sp.Expr]:
        return (self._expander.expression(node) for node in self._nodes)

    def matrix(self) -> sp.Matrix:
        """All entries as a SymPy matrix; a vector is a column, a stack of matrices is written one below the other."""
        return sp.Matrix(*self._matrix_shape(), list(self))

    def _matrix_shape(self) -> tuple[int, int]:
        size = len(self._nodes)
        rows = size if len(self.shape) < 2 else size // self.shape[-1]
        return rows, size // rows

    def readable(self, index: tuple[int, ...] | None = None) -> sp.Expr | sp.Matrix | SharedForm:
        """The matrix, or the entry at ``index`` (from 0), in the form that is easier to read.

        Expanded if that takes few terms, otherwise a :class:`SharedForm` with names for what occurs more than once.
        Raises IndexError outside the shape.
        """
        if index is None and self.shape == ():
            index = ()
        results = self._nodes if index is None else [self._nodes[self._flat(index)]]
        limit = int(TERMS_PER_NODE * len(reachable(self.program.nodes, results)))
        if self._expander.terms(results, limit) <= limit:
            return self.matrix() if index is None else self[index]
        shape = self._matrix_shape() if index is None else (1, 1)
        return shared_form(self.program, results, shape, self._inputs, self._expander.angles)

    def polynomial(self, index: tuple[int, ...]) -> Any:
        """The entry at ``index`` (from 0) as a polynomial in normal form, for exact comparisons."""
        return self._expander.value(self._nodes[self._flat(index)])


def closed_form(derivation: Derivation, function: str) -> ClosedForm:
    """The closed form of ``function`` with named parameters and base parameters as symbols.

    For a function with several results, name one: ``"inverse_dynamics_derivatives.dtau_dq"``. Raises DerivationError if
    the function has no closed form or no such result.
    """
    forms = closed_forms(derivation, function)
    if len(forms) > 1:
        raise DerivationError(f"name one result: {', '.join(forms)}")
    return next(iter(forms.values()))


def closed_forms(derivation: Derivation, function: str) -> dict[str, ClosedForm]:
    """The closed forms of all results of ``function``, by name: "energy" has "energy.kinetic" and "energy.potential".

    A function with one result has one entry, under its own name; "energy.kinetic" names one result of several. Raises
    DerivationError if the function has no closed form or no such result.
    """
    name, _, wanted = function.partition(".")
    if name not in CLOSED:
        raise DerivationError(f"no closed form of {function!r}; there is one of: {', '.join(CLOSED)}")
    model, parametrization = derivation.model, derivation.parametrization
    further = [v for row in parametrization.inverse or () for v in row]
    free, pairs, roots = exact_constants(model, further)
    generators = [*free, *(g for pair in pairs for g in pair), *roots]
    recording = Recording(model, parametrization, generators or [sp.Symbol("one")])
    program = recorders(name)[0](recording)
    drives = [term.name for term in inertia_terms(model.spec)]
    parameters = {Role.BASE_PARAMETERS: [*parametrization.names, *drives]}
    results = [port.name for port in program.outputs]
    if wanted and wanted not in results:
        known = ", ".join(f"{name}.{result}" for result in results)
        raise DerivationError(f"no result {function!r}; there is {known}")
    return {
        f"{name}.{result}" if len(results) > 1 else name: ClosedForm(
            program, output, generators or [sp.Symbol("one")], roots, parameters, pairs
        )
        for output, result in enumerate(results)
        if wanted in ("", result)
    }


def _input_symbols(
    program: Program, generators: Sequence[sp.Expr], parameters: Mapping[Role, Sequence[str]]
) -> list[list[sp.Expr]]:
    symbols: list[list[sp.Expr]] = []
    for port in program.inputs:
        if port.role is Role.GEOMETRY:
            symbols.append(list(generators))
        elif port.role in parameters:
            symbols.append([sp.Symbol(name, real=True) for name in parameters[port.role]])
        elif port.shape == ():
            symbols.append([sp.Symbol(port.name, real=True)])
        else:
            symbols.append(list(joint_symbols(port.size, port.name)))
    return symbols


class _Expander:
    """Expands the nodes of a program into polynomials, on demand."""

    def __init__(
        self,
        program: Program,
        inputs: list[list[sp.Expr]],
        constant_pairs: Sequence[tuple[sp.Expr, sp.Expr]],
        roots: Sequence[sp.Expr],
    ) -> None:
        self.program = program
        self.inputs = inputs
        self._values: dict[int, Any] = {}
        angles = {node.args[0]: None for node in program.nodes if node.op in (Op.SIN, Op.COS)}
        self.angles = {index: self._angle(index) for index in angles}
        pairs = [(sp.cos(angle), sp.sin(angle)) for angle in dict.fromkeys(self.angles.values())]
        paired = {g for pair in constant_pairs for g in pair} | set(roots)
        free = [s for port in inputs for s in port if s not in paired]
        self.pairs = [*pairs, *constant_pairs]
        self.ring = PolynomialRing(list(dict.fromkeys(free)), self.pairs, roots)
        self.rates = [s for port, row in zip(program.inputs, inputs, strict=True)
                      if port.role.is_rate for s in row]  # fmt: skip
        self.parameters = [s for port, row in zip(program.inputs, inputs, strict=True)
                           if port.role is Role.BASE_PARAMETERS for s in row]  # fmt: skip

    def _angle(self, index: int) -> sp.Expr:
        """The node ``index``, a linear combination of joint angles and constants, as a SymPy expression."""
        node = self.program.nodes[index]
        if node.op is Op.INPUT:
            port, element = node.place
            return self.inputs[port][element]
        if node.op is Op.CONST:
            return to_expression(node.number)
        parts = [self._angle(arg) for arg in node.args]
        operations: dict[Op, Callable[..., sp.Expr]] = {
            Op.ADD: lambda x, y: x + y,
            Op.SUB: lambda x, y: x - y,
            Op.NEG: lambda x: -x,
            Op.MUL: lambda x, y: x * y,
        }
        return operations[node.op](*parts)

    def value(self, index: int) -> Any:
        """The polynomial of one node."""
        for k in reachable(self.program.nodes, [index]):
            if k not in self._values:
                self._values[k] = self._evaluate(k)
        return self._values[index]

    def terms(self, indices: Sequence[int], limit: int) -> int:
        """Count the terms that the nodes ``indices`` have when expanded; stops early with a count above ``limit``."""
        for k in reachable(self.program.nodes, indices):
            factors = [_length(self._values[arg]) for arg in self.program.nodes[k].args if arg in self._values]
            if math.prod(factors) > limit**2:  # the product of so many terms would take seconds
                return limit + 1
            if _length(self.value(k)) > limit:
                return limit + 1
        return sum(_length(self.value(k)) for k in set(indices))

    def _evaluate(self, index: int) -> Value | Polynomial:
        node = self.program.nodes[index]
        if node.op is Op.INPUT:
            port, element = node.place
            return self.ring.generator(self.inputs[port][element])
        if node.op is Op.CONST:
            return node.number
        if node.op in (Op.COS, Op.SIN):
            function = sp.cos if node.op is Op.COS else sp.sin
            return self.ring.generator(function(self.angles[node.args[0]]))
        if node.op is Op.SELECT or node.op not in _ARITHMETIC:
            raise DerivationError(f"{self.program.name} has no closed form")
        result: Value | Polynomial = _ARITHMETIC[node.op](*(self._values[arg] for arg in node.args))
        return result

    def expression(self, index: int) -> sp.Expr:
        """The node ``index`` as a readable expression: sum of parameter * (sum of rates * trigonometry)."""
        value = self.value(index)
        if not isinstance(value, Polynomial):
            return to_expression(value)
        terms = []
        for powers, part in value.coefficients(self.parameters).items():
            inner = []
            for rates, trig in part.coefficients(self.rates).items() if isinstance(part, Polynomial) else [((), part)]:
                form = shorter_form(trig, self.pairs) if isinstance(trig, Polynomial) else to_expression(trig)
                inner.append(_monomial(self.rates, rates) * form)
            terms.append(_monomial(self.parameters, powers) * sp.Add(*inner))
        return sp.Add(*terms)


_ARITHMETIC: dict[Op, Callable[..., Any]] = {
    Op.ADD: lambda x, y: x + y,
    Op.SUB: lambda x, y: x - y,
    Op.MUL: lambda x, y: x * y,
    Op.DIV: lambda x, y: x / y,
    Op.NEG: lambda x: -x,
}


def _length(value: Value | Polynomial) -> int:
    """The number of terms of a polynomial; 1 for a number."""
    return len(value.poly) if isinstance(value, Polynomial) else 1


def _monomial(generators: Sequence[sp.Expr], powers: Sequence[int]) -> sp.Expr:
    return sp.Mul(*(g**e for g, e in zip(generators, powers, strict=False) if e))
