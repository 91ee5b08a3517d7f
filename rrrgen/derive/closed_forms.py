"""Closed forms: the formula of a function, with intermediate results expanded and terms in sums of angles collected.

A function is recorded again with the geometry as symbols and expanded into polynomials in sines and cosines. The angles
of parallel axes are recorded as sums, so terms in cos(q2 + q3) collect without trigonometric identities. Single entries
can be expanded alone, for robots whose whole matrices would fill pages.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import count, product
from typing import Any

import sympy as sp

from rrrgen.base.errors import DerivationError
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.derive.derived_model import Derivation
from rrrgen.derive.functions.recording import FunctionBuilder
from rrrgen.derive.functions.table import TABLE, find, recorders
from rrrgen.derive.recursions.link_frames import exact_constants, joint_symbols
from rrrgen.program import Op, Program, Role, Value
from rrrgen.program.polynomials import Polynomial, PolynomialRing, to_expression
from rrrgen.program.program import reachable
from rrrgen.robot.model.drives import inertia_terms

# ------------------------------------------------------------------------------------------------------------------
# Exact numbers as people write them: 9.81 where SymPy prints 981/100.
# ------------------------------------------------------------------------------------------------------------------


def decimal_text(value: sp.Rational) -> str | None:
    """Print ``value`` as an integer or a decimal fraction; None if the fraction p/q is easier to read.

    Simple fractions stay fractions; infinite or very long decimal expansions are shown to 12 digits.
    """
    if value.q == 1:
        return str(value.p)
    rest = int(value.q)
    for prime in (2, 5):
        while rest % prime == 0:
            rest //= prime
    if value.q <= 10 or (rest != 1 and max(abs(value.p), value.q) < 10**6):
        return None
    return f"{float(value):.12g}"


def with_decimals_inside(product: sp.Expr) -> sp.Expr:
    """Multiply decimal factors into sums, so that the numbers of the robot file appear.

    ``0.025*(13*c1 + 11*c12)`` becomes ``0.325*c1 + 0.275*c12``.
    """
    number, rest = product.as_coeff_Mul()
    if not number.is_Rational or number.q == 1 or decimal_text(number) is None:
        return product
    factors = list(sp.Mul.make_args(rest))
    for k, factor in enumerate(factors):
        if factor.is_Add:
            factors[k] = sp.Add(*(number * term for term in factor.args))
            return sp.Mul(*factors)
    return product


def with_decimals(expression: sp.Expr) -> sp.Expr:
    """``expression`` for printing, no longer exact: rational numbers that read better as decimals become floats.

    Exponents and simple fractions such as 1/2 stay as they are.
    """
    if expression.is_Rational:
        text = decimal_text(expression)
        return expression if expression.q == 1 or text is None else sp.Float(text)
    if expression.is_Mul:
        expression = with_decimals_inside(expression)
    if expression.is_Pow:
        return with_decimals(expression.base) ** expression.exp
    if expression.args:
        return expression.func(*(with_decimals(part) for part in expression.args))
    return expression


# ------------------------------------------------------------------------------------------------------------------
# Printing a trigonometric polynomial in the shorter of two forms: with products of sines and cosines, or of sums.
#
# The second form replaces products of angles of one block of parallel axes by multiple angles, as in ``cos(q2)
# cos(q2+q3) + sin(q2) sin(q2+q3) = cos(q3)``. Angles of different blocks are never mixed.
# ------------------------------------------------------------------------------------------------------------------

Pairs = Sequence[tuple[sp.Expr, sp.Expr]]
Wave = dict[sp.Expr, tuple[Fraction, Fraction]]
"""Sum of ``a cos(angle) + b sin(angle)``, keyed by the angle."""


def shorter_form(value: Polynomial, pairs: Pairs) -> sp.Expr:
    """Convert ``value`` to a SymPy expression, in the one of the module's two forms that has fewer operations.

    ``pairs`` are the (cosine, sine) generators of the angles in it.
    """
    plain = sp.factor_terms(value.expression())
    best = plain
    for block in _blocks(pairs):
        waves = sp.factor_terms(_as_waves(value, block))
        if waves.count_ops() < best.count_ops():
            best = waves
    return best


def _blocks(pairs: Pairs) -> list[Pairs]:
    """The (cosine, sine) pairs grouped into sets whose angles share joint variables."""
    blocks: list[tuple[set[sp.Symbol], list[tuple[sp.Expr, sp.Expr]]]] = []
    for pair in pairs:
        symbols = pair[0].args[0].free_symbols
        home = next((block for block in blocks if block[0] & symbols), None)
        if home is None:
            blocks.append((set(symbols), [pair]))
        else:
            home[0].update(symbols)
            home[1].append(pair)
    return [members for symbols, members in blocks if symbols]


def _as_waves(value: Polynomial, block: Pairs) -> sp.Expr:
    generators = [g for pair in block for g in pair]
    total: dict[sp.Expr, Any] = {}
    for powers, rest in value.coefficients(generators).items():
        wave: Wave = {sp.S.Zero: (Fraction(1), Fraction(0))}
        for (cosine, _), k in zip(block, range(0, len(powers), 2), strict=True):
            for _ in range(powers[k]):
                wave = _times(wave, cosine.args[0], Fraction(1), Fraction(0))
            for _ in range(powers[k + 1]):
                wave = _times(wave, cosine.args[0], Fraction(0), Fraction(1))
        for angle, (a, b) in wave.items():
            for function, factor in ((sp.cos(angle), a), (sp.sin(angle), b)):
                if factor:
                    total[function] = total.get(function, 0) + factor * rest
    return sp.Add(*(to_expression(v) * function for function, v in total.items()))


def _times(wave: Wave, angle: sp.Expr, a: Fraction, b: Fraction) -> Wave:
    """Multiply ``wave``, a sum of sines and cosines, by ``a cos(angle) + b sin(angle)``; the result is such a sum."""
    result: Wave = {}
    half = Fraction(1, 2)
    for present, (c, d) in wave.items():
        _accumulate(result, present + angle, half * (c * a - d * b), half * (c * b + d * a))
        _accumulate(result, present - angle, half * (c * a + d * b), half * (d * a - c * b))
    return result


def _accumulate(wave: Wave, angle: sp.Expr, a: Fraction, b: Fraction) -> None:
    if angle.could_extract_minus_sign():
        angle, b = -angle, -b
    if angle == 0:
        b = Fraction(0)
    old = wave.get(angle, (Fraction(0), Fraction(0)))
    wave[angle] = (old[0] + a, old[1] + b)


# ------------------------------------------------------------------------------------------------------------------
# Closed forms with named intermediate results, for functions that would fill pages when expanded.
# ------------------------------------------------------------------------------------------------------------------

LETTER = "t"
"""Intermediate results are called t1, t2, ..."""


@dataclass(frozen=True)
class SharedForm:
    """A matrix whose entries use intermediate results: ``definitions`` in order of evaluation, then ``matrix``.

    A definition (symbol, expression) uses inputs, parameters and earlier symbols only. Substituted from the last to the
    first, the definitions turn ``matrix`` into the expanded closed form.
    """

    definitions: tuple[tuple[sp.Symbol, sp.Expr], ...]
    matrix: sp.Matrix

    @property
    def free_symbols(self) -> set[sp.Symbol]:
        """The symbols of the function itself, without those of the definitions."""
        parts = [self.matrix, *(value for _, value in self.definitions)]
        return set().union(*(part.free_symbols for part in parts)) - {symbol for symbol, _ in self.definitions}


def shared_form(
    program: Program,
    results: Sequence[int],
    shape: tuple[int, int],
    inputs: Sequence[Sequence[sp.Expr]],
    angles: Mapping[int, sp.Expr],
) -> SharedForm:
    """Write the nodes ``results`` of ``program`` as a matrix of ``shape``, with names for values used more than once.

    ``inputs`` holds one symbol per element of every input, ``angles`` the expression of every node that is the argument
    of a sine or cosine. Sines and cosines stay whole: they are part of the notation.
    """
    needed = _nodes_to_print(program, results)
    uses = _uses(program, needed, results)
    taken = {str(symbol) for port in inputs for symbol in port}
    names = (name for k in count(1) if (name := f"{LETTER}{k}") not in taken)
    definitions: list[tuple[sp.Symbol, sp.Expr]] = []
    values: dict[int, sp.Expr] = {}
    for k in needed:
        node = program.nodes[k]
        if node.op is Op.INPUT:
            port, element = node.place
            value = inputs[port][element]
        elif node.op is Op.CONST:
            value = to_expression(node.number)
        elif node.op in (Op.SIN, Op.COS):
            value = (sp.sin if node.op is Op.SIN else sp.cos)(angles[node.args[0]])
        else:
            value = _OPERATIONS[node.op](*(values[arg] for arg in node.args))
            if uses[k] > 1 and not _is_short(value):
                symbol = sp.Symbol(next(names), real=True)
                definitions.append((symbol, value))
                value = symbol
        values[k] = value
    return SharedForm(tuple(definitions), sp.Matrix(*shape, [values[k] for k in results]))


def _nodes_to_print(program: Program, results: Sequence[int]) -> list[int]:
    """The nodes that ``results`` are computed from, in order, without those that only stand inside sines and cosines.

    A number may stand in both places: an angle of 0.25 rad beside a length of 0.25 m.
    """
    order = reachable(program.nodes, results)
    printed = set(results)
    for k in reversed(order):
        if k in printed and program.nodes[k].op not in (Op.SIN, Op.COS):
            printed.update(program.nodes[k].args)
    return [k for k in order if k in printed]


def _uses(program: Program, needed: Iterable[int], results: Sequence[int]) -> Counter[int]:
    """Count how often each node is printed; x + x, printed as 2*x, counts once, and so do equal entries."""
    nodes = (program.nodes[k] for k in needed)
    used = Counter(arg for node in nodes for arg in (set(node.args) if node.op is Op.ADD else node.args))
    return used + Counter(set(results))


def _is_short(value: sp.Expr) -> bool:
    """Whether ``value`` is so short that naming it gains nothing: a symbol, number or sine, or its negative."""
    _, rest = value.as_coeff_Mul()
    return bool((rest.is_Atom or rest.is_Function) and value in (rest, -rest))


_OPERATIONS: dict[Op, Callable[..., sp.Expr]] = {
    Op.ADD: lambda x, y: x + y,
    Op.SUB: lambda x, y: x - y,
    Op.MUL: lambda x, y: x * y,
    Op.DIV: lambda x, y: x / y,
    Op.NEG: lambda x: -x,
}


# ------------------------------------------------------------------------------------------------------------------
# Closed forms
# ------------------------------------------------------------------------------------------------------------------

CLOSED = tuple(f.name for f in TABLE if f.group == "model" and not f.name.startswith(("forward_dynamics", "tip_")))
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
    if derivation.spec.loops:
        raise DerivationError(
            f"{derivation.spec.name}: no closed forms are printed with closed loops, which take roots"
        )
    name, _, wanted = function.partition(".")
    entry, parametrization = find(name), derivation.parametrization
    tip = entry.tip if entry is not None and entry.tip in derivation.spec.tips else ""
    if (name.removeprefix(f"{tip}_") if tip else name) not in CLOSED:
        meant = did_you_mean(name, CLOSED) if entry is None else ""  # what exists was not meant to be another
        there = f"there is one of: {', '.join(CLOSED)}"
        raise DerivationError(f"no closed form of {function!r}; {meant or there}")
    model = derivation.model.at_tip(tip) if tip else derivation.model
    further = [v for row in parametrization.inverse or () for v in row]
    free, pairs, roots = exact_constants(model, further)
    generators = [*free, *(g for pair in pairs for g in pair), *roots]
    recording = FunctionBuilder(model, parametrization, generators or [sp.Symbol("one")])
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
