"""Sampled rounding errors of a program, to be set beside the proven bounds: random states, corners, a hill climb.

The program is evaluated in the emitted precision, with the emitted kernel of sine and cosine coded again, and in a
wider format: 80-bit long double for double, double for float. Where the machine has no wider long double, errors in
double are not sampled.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.emit.c.language import COSINE, HALF_PI, ROUNDING, SINE
from rrrgen.evidence.boxes import PortRange
from rrrgen.evidence.rounding import DOUBLE, FLOAT, Precision
from rrrgen.evidence.wide_arithmetic import WideProgram, compile_wide
from rrrgen.program import Op, Program, Role

Array = NDArray[Any]

ARITHMETIC: dict[Op, Callable[..., Any]] = {
    Op.ADD: operator.add,
    Op.SUB: operator.sub,
    Op.MUL: operator.mul,
    Op.DIV: operator.truediv,
    Op.NEG: operator.neg,
}
"""The operations that every kind of number has, arrays in any precision and numbers of mpmath alike."""


def has_wide_format(precision: Precision) -> bool:
    """Whether this machine evaluates more precisely than ``precision``, by at least ten bits."""
    return precision is FLOAT or np.finfo(np.longdouble).nmant >= 62


RESOLUTION = 1.001
"""Factor within which the sampled errors are right: the wider format rounds too."""

_CLIMBED = 8  # elements of a port from which the search goes on; every state of it counts for all elements
_NEIGHBOURS = 64  # states tried around each of them in a step
_STATES_OF_A_SEARCH = 20_000  # random states from whose worst ones a search begins
_TOGETHER = 2e6  # nodes times states evaluated together: 32 MB in the wider format
_COMPILED = 3e8  # nodes times states from which on compiling the wider format takes less time than NumPy

Evaluator = Callable[[Sequence[Array]], Sequence[Array]]
"""Evaluates a program at (states, size) values of every input port: one array (states, size) per output."""


def largest_errors(
    program: Program,
    box: Mapping[str, PortRange],
    precision: Precision,
    samples: int,
    seed: int,
    climbs: int = 20,
    compiled: Evaluator | None = None,
    conditional: Sequence[bool] = (),
) -> NDArray[np.float64]:
    """The largest errors found, one per output element in order, over ``samples`` states and ``climbs`` steps uphill.

    Half of the states have their rates, torques and gains at corners of the box. A step moves the worst states of the
    outputs a little, and keeps each where the error has grown; of a port with many elements, those with the largest
    errors. The wider format rounds too, so that the figures are good to three digits. ``compiled`` evaluates the
    program in the emitted precision, such as compiled code; by default it is evaluated here. ``conditional`` is as for
    :func:`errors_at`.
    """

    exact = None if any(conditional) else compile_if_worthwhile(program, precision, samples)

    def measure(states: Sequence[Array]) -> NDArray[np.float64]:
        return errors_at(program, states, precision, compiled, conditional, exact)

    return _search_repeatedly(measure, program, box, precision, samples, seed, climbs)


def compile_if_worthwhile(program: Program, precision: Precision, samples: int) -> WideProgram | None:
    """``program`` compiled in the wider format where ``samples`` states are worth it and there is a compiler."""
    return compile_wide(program, precision) if samples * len(program.nodes) > _COMPILED else None


def wide_outputs(program: Program, precision: Precision, samples: int) -> Callable[[Sequence[Array]], Array]:
    """A function from values (states, size) of every input port to all output elements (elements, states), wider."""
    compiled = compile_if_worthwhile(program, precision, samples)
    if compiled is not None:
        return compiled.outputs
    wide = np.longdouble if precision is DOUBLE else np.float64
    order = [index for row in program.results for index in row]

    def evaluate(states: Sequence[Array]) -> Array:
        values = _evaluate_nodes(program, states, precision, wide)
        return np.stack([np.broadcast_to(values[index], len(states[0]) if states else 1) for index in order])

    return evaluate


Measure = Callable[[Sequence[Array]], NDArray[np.float64]]
"""The errors (outputs, states) of all output elements at values (states, size) of every input port."""


def _search_repeatedly(
    measure: Measure,
    program: Program,
    box: Mapping[str, PortRange],
    precision: Precision,
    samples: int,
    seed: int,
    climbs: int,
) -> NDArray[np.float64]:
    """The largest errors that random states and searches uphill find, one for every row of what ``measure`` returns.

    After every :data:`_STATES_OF_A_SEARCH` states a search of its own begins at the worst of these.
    """
    rng = np.random.default_rng(seed)
    counts = [min(_STATES_OF_A_SEARCH, samples - first) for first in range(0, samples, _STATES_OF_A_SEARCH)]
    maxima = [_search(measure, program, box, precision, count, rng, climbs) for count in counts]
    return np.asarray(np.max(maxima, axis=0), dtype=np.float64)


def _search(
    measure: Measure,
    program: Program,
    box: Mapping[str, PortRange],
    precision: Precision,
    samples: int,
    rng: np.random.Generator,
    climbs: int,
) -> NDArray[np.float64]:
    """The largest errors of ``samples`` random states and of ``climbs`` steps uphill from the worst of them."""
    narrow = np.float64 if precision is DOUBLE else np.float32
    most = max(_NEIGHBOURS, int(_TOGETHER / len(program.nodes)))  # states evaluated together
    size = sum(map(len, program.results))
    best = np.zeros(size)
    champions = [np.zeros((size, port.size), dtype=narrow) for port in program.inputs]
    for first in range(0, samples, most):
        states = _states(program, box, min(most, samples - first), rng, narrow)
        errors = measure(states)
        place, worst = errors.argmax(axis=1), errors.max(axis=1)
        grown = (worst > best) | (first == 0)
        for champion, state in zip(champions, states, strict=True):
            champion[grown] = state[place[grown]]
        best = np.maximum(best, worst)
    climbed = _outputs_to_climb(program, best)
    for step in range(climbs):
        reach = 0.1 * 0.7**step
        moved = []
        for (lower, upper), champion in zip(_edges(program, box), champions, strict=True):
            state = champion[climbed]
            shift = rng.uniform(-reach, reach, (_NEIGHBOURS, *state.shape)) * (upper - lower)
            moved.append(np.clip(state + shift, lower, upper).astype(narrow).reshape(-1, state.shape[1]))
        count = len(moved[0]) if moved else 1
        for first in range(0, count, most):
            states = [state[first : first + most] for state in moved]
            errors = measure(states)
            place, worst = errors.argmax(axis=1), errors.max(axis=1)
            grown = worst > best
            for champion, state in zip(champions, states, strict=True):
                champion[grown] = state[place[grown]]
            best = np.maximum(best, worst)
    return best


def relative_errors(
    program: Program, box: Mapping[str, PortRange], precision: Precision, samples: int, seed: int
) -> NDArray[np.float64]:
    """The relative errors (samples,) at random states: of the outputs' the largest, in the maximum norm of an output.

    States are those of :func:`largest_errors`. An output that is zero counts as right.
    """
    narrow = np.float64 if precision is DOUBLE else np.float32
    rng = np.random.default_rng(seed)
    most = max(_NEIGHBOURS, int(_TOGETHER / len(program.nodes)))
    wide = np.longdouble if precision is DOUBLE else np.float64
    errors = []
    for first in range(0, samples, most):
        count = min(most, samples - first)
        states = _states(program, box, count, rng, narrow)
        values, exact = (_evaluate_nodes(program, states, precision, kind) for kind in (None, wide))
        worst = np.zeros(count)
        for row in program.results:
            size = np.max([np.broadcast_to(np.abs(exact[index]), count) for index in row], axis=0)
            difference = np.max(
                [np.broadcast_to(np.abs(values[index].astype(wide) - exact[index]), count) for index in row], axis=0
            )
            share = np.divide(difference, size, out=np.zeros(count, dtype=wide), where=size > 0.0)
            worst = np.maximum(worst, share.astype(np.float64))
        errors.append(worst)
    return np.concatenate(errors)


def largest_residuals(
    program: Program,
    mass: Program,
    bias: Program,
    box: Mapping[str, PortRange],
    precision: Precision,
    samples: int,
    seed: int,
    climbs: int = 20,
    compiled: Evaluator | None = None,
) -> NDArray[np.float64]:
    """The largest residuals ``|M ddq - (tau - h)|`` found of the forward dynamics ``program``, one for every joint.

    ``mass`` and ``bias`` are the programs of M and h. The range "ddq" of the ``box`` is that of the accelerations from
    which the torques of a state follow. States where the status is not ok, or where the accelerations that are found
    leave their range, do not count. The rest is as for :func:`largest_errors`.
    """
    narrow = np.float64 if precision is DOUBLE else np.float32
    wide = np.longdouble if precision is DOUBLE else np.float64
    ports = [port.role for port in program.inputs]
    place, reach = ports.index(Role.TORQUE), np.array(box["ddq"].upper)
    ranges = {p.name: box["ddq"] if p.role is Role.TORQUE else box[p.name] for p in program.inputs}

    exact = {other: wide_outputs(program, precision, samples) for other, program in (("M", mass), ("h", bias))}

    def of(name: str, other: Program, states: Sequence[Array]) -> Array:
        """The first output (size, states) of another program at the same states, in the wider format."""
        given = [states[[port.name for port in program.inputs].index(port.name)] for port in other.inputs]
        return exact[name](given)[: len(other.results[0])]

    def measure(states: Sequence[Array]) -> NDArray[np.float64]:
        n, count = len(reach), len(states[0])
        M, h = of("M", mass, states).reshape(n, n, count), of("h", bias, states)
        wanted = states[place].astype(wide).T
        tau = ((M * wanted).sum(axis=1) + h).astype(narrow)
        given = [tau.T if k == place else state for k, state in enumerate(states)]
        outputs = _outputs(program, given, precision, compiled)
        solution = outputs[0].reshape(count, n).astype(wide).T
        residual = np.abs((M * solution).sum(axis=1) + h - tau.astype(wide))
        counts = (np.abs(solution) <= reach[:, None]).all(axis=0) & (outputs[1].reshape(count) == 0)
        of_status = np.zeros((1, count))
        return np.vstack([np.where(counts, residual, 0.0).astype(np.float64), of_status])

    return _search_repeatedly(measure, program, ranges, precision, samples, seed, climbs)[: len(reach)]


def largest_derivative_residuals(
    program: Program,
    derivatives: Program,
    box: Mapping[str, PortRange],
    inverse: Sequence[float],
    precision: Precision,
    samples: int,
    seed: int,
    climbs: int = 20,
    compiled: Evaluator | None = None,
) -> NDArray[np.float64]:
    """The largest residuals found of ``program``, the derivatives of forward dynamics, one for every output element.

    They are ``M ddq - (tau - h)``, ``M dddq_dq + dtau_dq``, ``M dddq_dv + dtau_dv`` and ``M dddq_dtau - 1``, with what
    ``derivatives``, the program of those of inverse dynamics, returns at the ddq of the result. States do not count
    where the status is not ok, torques or accelerations leave their ranges, or a diagonal entry of dddq_dtau exceeds
    ``inverse``. The rest is as for :func:`largest_residuals`.
    """
    narrow = np.float64 if precision is DOUBLE else np.float32
    wide = np.longdouble if precision is DOUBLE else np.float64
    place = [port.role for port in program.inputs].index(Role.TORQUE)
    lowest, highest = (np.array(bound) for bound in box[program.inputs[place].name].bounds)
    reach = np.array(box["ddq"].upper)
    n = len(reach)
    ranges = {p.name: box["ddq"] if p.role is Role.TORQUE else box[p.name] for p in program.inputs}
    names = [port.name for port in program.inputs]
    exact = wide_outputs(derivatives, precision, samples)

    def reference(states: Sequence[Array], ddq: Array) -> list[Array]:
        """Inverse dynamics at the accelerations ``ddq`` in the wider format, with which results are compared.

        Returns the torques (n, states), their derivatives by positions and by speeds, and the mass matrix, each
        (n, n, states).
        """
        given = [
            ddq if port.role is Role.ACCELERATION else states[names.index(port.name)] for port in derivatives.inputs
        ]
        ends = np.cumsum([len(row) for row in derivatives.results])
        rows = np.split(exact(given), ends[:-1])
        return [rows[0], *(row.reshape(n, n, len(ddq)) for row in rows[1:])]

    def measure(states: Sequence[Array]) -> NDArray[np.float64]:
        count = len(states[0])
        tau = reference(states, states[place])[0].astype(narrow).T
        given = [tau if k == place else state for k, state in enumerate(states)]
        outputs = _outputs(program, given, precision, compiled)
        solution, *matrices = [np.asarray(output.astype(wide).T) for output in outputs[:4]]
        by_q, by_v, by_tau = (matrix.reshape(n, n, count) for matrix in matrices)
        at_solution, dtau_dq, dtau_dv, M = reference(states, outputs[0])
        identity = np.eye(n)[:, :, None]
        residuals = [
            at_solution - tau.astype(wide).T,
            *(
                np.einsum("ikc,kjc->ijc", M, derivative) + right
                for derivative, right in ((by_q, dtau_dq), (by_v, dtau_dv), (by_tau, -identity))
            ),
        ]
        counts = (np.abs(solution) <= reach[:, None]).all(axis=0) & (outputs[4].reshape(count) == 0)
        counts &= ((lowest <= tau) & (tau <= highest)).all(axis=1)
        counts &= (np.einsum("iic->ic", by_tau) <= np.array(inverse)[:, None]).all(axis=0)
        rows = np.vstack([np.abs(residual).reshape(-1, count) for residual in residuals])
        return np.vstack([np.where(counts, rows, 0.0).astype(np.float64), np.zeros((1, count))])

    return _search_repeatedly(measure, program, ranges, precision, samples, seed, climbs)[:-1]


def _outputs(
    program: Program, states: Sequence[Array], precision: Precision, compiled: Evaluator | None
) -> list[Array]:
    """The outputs (states, size) of ``program`` in the emitted precision: of ``compiled`` code, or evaluated here."""
    count = len(states[0])
    if compiled is not None:
        return [np.asarray(output).reshape(count, -1) for output in compiled(states)]
    values = _evaluate_nodes(program, states, precision, None)
    return [np.stack([np.broadcast_to(values[e], count) for e in row], axis=1) for row in program.results]


def _outputs_to_climb(program: Program, errors: NDArray[np.float64]) -> NDArray[np.intp]:
    """The output elements from whose worst states the search goes on: those of every port with the largest errors."""
    chosen, first = [], 0
    for row in program.results:
        order = np.argsort(-errors[first : first + len(row)], kind="stable")
        chosen.append(first + order[:_CLIMBED])
        first += len(row)
    return np.concatenate(chosen)


def errors_at(
    program: Program,
    states: Sequence[Array],
    precision: Precision,
    compiled: Evaluator | None = None,
    conditional: Sequence[bool] = (),
    exact: WideProgram | None = None,
) -> NDArray[np.float64]:
    """The errors (outputs, states) of all output elements at ``states``, one array (states, size) per input port.

    ``conditional`` says which outputs have bounds that hold only where comparisons come out as in exact arithmetic:
    where one is otherwise in the wider format, these count as zero. A difference within the spacing of the wider
    format is no error: the bound of a constant, its exact distance from its literal, may be smaller.
    ``exact`` is the program in the wider format, with which errors of ``compiled`` code take less time; None where
    outputs are conditional.
    """
    wide = np.longdouble if precision is DOUBLE else np.float64
    order = [index for row in program.results for index in row]
    count = len(states[0]) if states else 1
    if exact is not None and compiled is not None:
        return exact.errors(states, compiled(states))
    values = _evaluate_nodes(program, states, precision, None) if compiled is None or any(conditional) else []
    others = _evaluate_nodes(program, states, precision, wide)
    if compiled is None:
        rounded = np.stack([np.broadcast_to(values[index], count) for index in order])
    else:
        rounded = np.concatenate([np.asarray(output).reshape(count, -1).T for output in compiled(states)])
    right = np.stack([np.broadcast_to(others[index], count) for index in order])
    difference = np.abs(rounded.astype(wide) - right)
    difference -= np.finfo(wide).eps * np.abs(right)
    errors = np.maximum(difference, 0.0).astype(np.float64)
    if any(conditional):
        rows = np.repeat(conditional, [len(row) for row in program.results])
        errors[rows] *= _same_choices(program, values, others)
    return np.asarray(errors)


def _same_choices(program: Program, values: Sequence[Array], others: Sequence[Array]) -> NDArray[np.bool_]:
    """At which states all comparisons of the program come out alike in two evaluations of its nodes."""
    same = np.array([True])
    for index, node in enumerate(program.nodes):
        if node.op is Op.SELECT:
            same = same & ((values[node.args[0]] > 0) == (others[node.args[0]] > 0))
        elif node.op is Op.SIGN:
            same = same & (values[index] == others[index])
    return same


def _edges(program: Program, box: Mapping[str, PortRange]) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    return [(np.array(box[port.name].lower), np.array(box[port.name].upper)) for port in program.inputs]


def _states(
    program: Program, box: Mapping[str, PortRange], samples: int, rng: np.random.Generator, narrow: type[Any]
) -> list[Array]:
    states = []
    for port, (lower, upper) in zip(program.inputs, _edges(program, box), strict=True):
        share = rng.uniform(0.0, 1.0, (samples, port.size))
        if port.role.is_rate or port.role in (Role.TORQUE, Role.OTHER):
            share[::2] = np.round(share[::2])
        rounded = (lower + share * (upper - lower)).astype(narrow)
        states.append(np.clip(rounded, lower.astype(narrow), upper.astype(narrow)))
    return states


def evaluate_nodes(program: Program, states: Sequence[Array], precision: Precision) -> list[Array]:
    """The values (states,) of all nodes in the emitted precision, at values (states, size) of every input port."""
    return [np.broadcast_to(value, len(states[0])) for value in _evaluate_nodes(program, states, precision, None)]


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # states of faults overflow, as they do in C
def _evaluate_nodes(
    program: Program, states: Sequence[Array], precision: Precision, wide: type[Any] | None
) -> list[Array]:
    """The values of all nodes in the emitted precision (``wide`` None), or in the format ``wide``."""
    narrow = np.float64 if precision is DOUBLE else np.float32
    kind = narrow if wide is None else wide
    trig: dict[int, tuple[Array, Array]] = {}
    values: list[Array] = []
    for node in program.nodes:
        op, args = node.op, node.args
        x = [values[arg] for arg in args]
        if op is Op.INPUT:
            port, element = node.place
            values.append(states[port][:, element].astype(kind))
        elif op is Op.CONST:
            values.append(_literal(node.number, kind))
        elif op in ARITHMETIC:
            values.append(ARITHMETIC[op](*x))
        elif op in _FUNCTIONS:
            values.append(_FUNCTIONS[op](*x))
        elif op is Op.SELECT:
            values.append(np.where(x[0] > 0, x[1], x[2]))
        elif op is Op.SIN or op is Op.COS:
            if wide is not None:
                values.append(np.sin(x[0]) if op is Op.SIN else np.cos(x[0]))
            else:
                if args[0] not in trig:
                    trig[args[0]] = kernel(np.asarray(x[0]), precision)
                values.append(trig[args[0]][op is Op.COS])
        else:
            values.append(~np.isfinite(x[0]) * kind(1.0))
    return values


_FUNCTIONS: dict[Op, Callable[..., Any]] = {
    Op.SIGN: np.sign,
    Op.SQRT: np.sqrt,
    Op.ABS: np.abs,
    Op.MIN: np.minimum,
    Op.TANH: np.tanh,
    Op.EXP: np.exp,
}


def _literal(value: Any, kind: type[Any]) -> Array:
    exact = Fraction(value)
    if kind is np.float32:
        return np.asarray(np.float32(float(exact)))
    high = float(exact)
    if kind is np.float64:
        return np.asarray(high)
    return np.asarray(np.longdouble(high) + np.longdouble(float(exact - Fraction(high))))


def kernel(x: Array, precision: Precision) -> tuple[Array, Array]:
    """Sine and cosine of ``x`` by the emitted kernel, operation by operation."""
    kind = np.float64 if precision is DOUBLE else np.float32
    name = precision.name

    def number(text: str) -> Any:
        return kind(float(text))

    shift = number(ROUNDING[name])
    turns = (x * number("0.63661977236758134308") + shift) - shift
    quarter = turns.astype(np.int64)
    h = [number(text) for text in HALF_PI[name]]
    r = ((x - turns * h[0]) - turns * h[1]) - turns * h[2]
    z = r * r
    s = r + r * z * _horner([number(text) for text in SINE[name]], z)
    c = (kind(1.0) - kind(0.5) * z) + z * z * _horner([number(text) for text in COSINE[name]], z)
    sines = np.array([0.0, 1.0, 0.0, -1.0, 0.0], dtype=kind)
    t0, t1 = sines[quarter & 3], sines[(quarter & 3) + 1]
    return s * t1 + c * t0, c * t1 - s * t0


def _horner(coefficients: Sequence[Any], z: Array) -> Array:
    value = np.asarray(coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        value = coefficient + z * value
    return value
