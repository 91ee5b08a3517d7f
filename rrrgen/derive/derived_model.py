"""The results of derivation, the cache that keeps them between runs, and the format in which it does."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from itertools import chain
from typing import Any

import sympy as sp

from rrrgen.base.cache import compiler_hash, digest, keep
from rrrgen.base.cache import recall as recall_bytes
from rrrgen.base.errors import StorageError
from rrrgen.derive.functions.model_function import ModelFunction
from rrrgen.derive.functions.recording import FunctionBuilder, Parametrization
from rrrgen.derive.parameters.base_parameters import BaseParameter, BaseSet, Regrouping
from rrrgen.derive.parameters.user_basis import BasisChange
from rrrgen.program import OperationCount, Port, Program, Role, nominal_name
from rrrgen.program.passes import PassReport
from rrrgen.program.program import ARITY, Domain, Failure, Node, Op, Status
from rrrgen.robot.identity import Identity
from rrrgen.robot.model import RobotModel
from rrrgen.robot.spec import RobotSpec

# ------------------------------------------------------------------------------------------------------------------
# The results of derivation: :class:`RecordedModel` before optimization, :class:`DerivedModel` after it.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Derivation:
    """The starting point of every function of one robot: its geometry in canonical frames and its base parameters.

    ``compiler_basis`` is the set of base parameters that the compiler chooses, ``basis_change`` its relation to the set
    of the robot file (None if the file has none); ``parametrization`` converts the set in use to inertias of the links.
    """

    spec: RobotSpec
    model: RobotModel
    compiler_basis: BaseSet
    basis_change: BasisChange | None
    parametrization: Parametrization

    def recording(self) -> FunctionBuilder:
        """A new, empty recording of a function at nominal geometry."""
        return FunctionBuilder(self.model, self.parametrization)


@dataclass(frozen=True)
class ParametrizedRobot:
    """A robot with its base parameters, their relation to the standard parameters, and their nominal values.

    ``base_projection`` is K of ``beta = K phi``, shape (b, 10 n), at nominal geometry; ``regrouping`` says for every
    standard parameter whether it is kept, regrouped or without effect. ``beta_nominal`` (b,) and
    ``drive_inertia_nominal`` are the values of the robot file, None where it states none.
    """

    spec: RobotSpec
    base_parameters: tuple[BaseParameter, ...]
    base_projection: tuple[tuple[float, ...], ...]
    regrouping: tuple[Regrouping, ...]
    beta_nominal: tuple[Fraction, ...] | None
    drive_inertia_nominal: tuple[Fraction, ...] | None

    @property
    def name(self) -> str:
        """The name of the robot, which is the prefix of every emitted symbol."""
        return self.spec.name

    @property
    def nominal(self) -> dict[Role, tuple[Fraction, ...]]:
        """The parameters whose values the robot file states, by the role of their port: beta with drive inertias."""
        if self.beta_nominal is None:
            return {}
        return {Role.BASE_PARAMETERS: (*self.beta_nominal, *(self.drive_inertia_nominal or ()))}

    @property
    def b(self) -> int:
        """Number of base parameters."""
        return len(self.base_parameters)

    @property
    def links(self) -> int:
        """Number of links."""
        return len(self.spec.rows)

    @property
    def beta_size(self) -> int:
        """Number of elements of the port beta: base parameters, then drive inertias."""
        return self.b + len(self.drive_inertia_nominal or ())

    def make_recorded_model(
        self, derivation: Derivation, alternatives: dict[str, tuple[Program, ...]], wanted: tuple[str, ...]
    ) -> RecordedModel:
        """Make a recorded model of this robot for the functions ``wanted``.

        ``alternatives`` lists equivalent programs of these and of those that they are made of.
        """
        return RecordedModel(**self._field_values(), derivation=derivation, alternatives=alternatives, wanted=wanted)

    def _field_values(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(ParametrizedRobot)}


@dataclass(frozen=True)
class RecordedModel(ParametrizedRobot):
    """Every function as recorded, before optimization: ``alternatives`` lists equivalent programs per function.

    ``wanted`` are the functions of the model in the order of emission, also those that are made only of optimized
    programs of others; these others are among the alternatives, wanted or not.
    """

    derivation: Derivation
    alternatives: dict[str, tuple[Program, ...]]
    wanted: tuple[str, ...]

    def only(self, alternatives: Mapping[str, tuple[Program, ...]]) -> RecordedModel:
        """This model with the functions of ``alternatives`` and no others."""
        return replace(self, alternatives=dict(alternatives), wanted=tuple(alternatives))

    def make_derived_model(self, programs: dict[str, Program], passes: tuple[PassReport, ...]) -> DerivedModel:
        """Make the derived model of this robot from the optimized ``programs`` and the reports of the ``passes``."""
        return DerivedModel(**self._field_values(), programs=programs, passes=passes)


@dataclass(frozen=True)
class DerivedModel(ParametrizedRobot):
    """A robot with its optimized functions: all that backends, runtime and reports need.

    ``programs`` maps public function names to programs, in the order of emission. If the robot file states inertias,
    every function of the base parameters has a specialization ``<function>_nominal`` with those numbers folded in.
    """

    programs: dict[str, Program]
    passes: tuple[PassReport, ...]


def join_models(parts: Sequence[DerivedModel], functions: Sequence[ModelFunction]) -> DerivedModel:
    """The model with the functions of several models of one robot, in the order of ``functions``."""
    order = _order(functions)
    programs = {name: program for part in parts for name, program in part.programs.items()}
    # functions of one part may have been optimized again for those of another that are made of them
    passes = [report for part in parts for report in part.passes if report.function in part.programs]
    return replace(
        parts[0],
        programs={name: programs[name] for name in sorted(programs, key=order.__getitem__)},
        passes=tuple(sorted(passes, key=lambda report: order[report.function])),
    )


def _part(model: DerivedModel, functions: Sequence[ModelFunction]) -> DerivedModel:
    """The model with some of its ``functions`` alone."""
    wanted = _order(functions)
    return replace(
        model,
        programs={name: program for name, program in model.programs.items() if name in wanted},
        passes=tuple(report for report in model.passes if report.function in wanted),
    )


def _order(functions: Sequence[ModelFunction]) -> dict[str, int]:
    """The place of every program of ``functions``, a function before its specialization to the nominal parameters."""
    return {name: k for k, f in enumerate(functions) for name in (f.name, nominal_name(f.name))}


# ------------------------------------------------------------------------------------------------------------------
# The JSON format of derived models: pure data, so that reading a file never executes anything.
#
# Numbers, strings, None and tuples (as JSON lists) are written directly; everything else is an object with one key:
# ``dict`` (a list of pairs), ``ratio`` (a fraction "p/q"), ``expr`` (an expression), ``role`` or ``domain`` (of a
# port), ``program``, or another of :data:`RECORDS` with the list of its fields. The nodes of a program are stored as
# three columns: operations, operands and values.
# ------------------------------------------------------------------------------------------------------------------

RECORDS: dict[str, type[Any]] = {
    record.__name__: record for record in (BaseParameter, Regrouping, PassReport, OperationCount, Port, Status, Failure)
}
OPERATIONS = tuple(ARITY)
CODES = {op: code for code, op in enumerate(OPERATIONS)}
FUNCTIONS: dict[str, Callable[..., sp.Expr]] = {
    "Add": sp.Add,
    "Mul": sp.Mul,
    "Pow": sp.Pow,
    "sin": sp.sin,
    "cos": sp.cos,
    "UnevaluatedExpr": sp.UnevaluatedExpr,  # of angles whose cosines would become nested roots
}
CONSTANTS: dict[str, sp.Expr] = {"pi": sp.pi}


def dumps(values: Mapping[str, Any]) -> bytes:
    """``values`` as JSON in UTF-8. Raises TypeError for a value that the format cannot represent."""
    return json.dumps({name: _plain(value) for name, value in values.items()}, separators=(",", ":")).encode()


def loads(data: bytes) -> dict[str, Any]:
    """The inverse of :func:`dumps`. Raises ValueError, TypeError, LookupError or AttributeError on other data."""
    return {name: _value(plain) for name, plain in json.loads(data).items()}


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {"dict": [[key, _plain(item)] for key, item in value.items()]}
    if isinstance(value, Fraction):
        return {"ratio": str(value)}
    if isinstance(value, Program):
        return {"program": _plain_program(value)}
    if isinstance(value, sp.Expr):
        return {"expr": _plain_expression(value)}
    if isinstance(value, Role):
        return {"role": value.value}
    if isinstance(value, Domain):
        return {"domain": value.value}
    name = type(value).__name__
    if RECORDS.get(name) is not type(value):
        raise TypeError(f"{name} is not kept")
    return {name: [_plain(getattr(value, field.name)) for field in fields(value)]}


def _value(plain: Any) -> Any:
    if isinstance(plain, list):
        return tuple(_value(item) for item in plain)
    if not isinstance(plain, dict):
        return plain
    ((kind, content),) = plain.items()
    if kind == "dict":
        return {key: _value(item) for key, item in content}
    if kind == "ratio":
        return Fraction(content)
    if kind == "program":
        return _program(content)
    if kind == "role":
        return Role(content)
    if kind == "domain":
        return Domain(content)
    if kind == "expr":
        return _expression(content)
    return RECORDS[kind](*(_value(item) for item in content))


def _plain_program(program: Program) -> dict[str, Any]:
    described = {field.name: _plain(getattr(program, field.name)) for field in fields(Program) if field.name != "nodes"}
    values = [node.value for node in program.nodes if node.op is Op.INPUT or node.op is Op.CONST]
    return described | {
        "ops": [CODES[node.op] for node in program.nodes],
        "args": list(chain.from_iterable(node.args for node in program.nodes)),
        "values": [str(value) if isinstance(value, Fraction) else value for value in values],
    }


def _program(plain: dict[str, Any]) -> Program:
    args, values = iter(plain.pop("args")), map(_node_value, plain.pop("values"))
    none = ()
    nodes = []
    for code in plain.pop("ops"):
        op = OPERATIONS[code]
        if op is Op.INPUT or op is Op.CONST:
            nodes.append(Node(op, none, next(values)))
        elif (arity := ARITY[op]) == 2:
            nodes.append(Node(op, (next(args), next(args))))
        else:
            nodes.append(Node(op, tuple(next(args) for _ in range(arity))))
    return Program(nodes=tuple(nodes), **{name: _value(item) for name, item in plain.items()})


def _node_value(plain: Any) -> Any:
    if isinstance(plain, list):
        return tuple(plain)
    return Fraction(plain) if isinstance(plain, str) else plain


def _plain_expression(expression: sp.Basic) -> Any:
    """Convert a SymPy expression to JSON: an int, or a list.

    The lists are ``["symbol", name, assumptions]``, ``["number", "p/q"]`` and ``[function, operand, ...]``.
    """
    if isinstance(expression, sp.Symbol):
        return ["symbol", expression.name, _assumptions(expression)]
    if isinstance(expression, sp.Rational):
        return int(expression) if expression.is_Integer else ["number", f"{expression.p}/{expression.q}"]
    if isinstance(expression, sp.Float):
        raise TypeError("floating-point numbers are not kept in expressions")
    name = str(expression) if expression.is_NumberSymbol else type(expression).__name__
    if name not in (CONSTANTS if expression.is_NumberSymbol else FUNCTIONS):
        raise TypeError(f"{name} is not kept in expressions")
    return [name, *(_plain_expression(operand) for operand in expression.args)]


def _assumptions(symbol: sp.Symbol) -> dict[str, bool]:
    """Assumptions with which a SymPy symbol was created, such as ``{"real": True}``."""
    return {name: bool(value) for name, value in symbol._assumptions_orig.items() if value is not None}


def _expression(plain: Any) -> sp.Expr:
    if isinstance(plain, int):
        return sp.Integer(plain)
    kind, *rest = plain
    if kind == "symbol":
        return sp.Symbol(rest[0], **rest[1])
    if kind == "number":
        return sp.Rational(rest[0])
    if kind in CONSTANTS:
        return CONSTANTS[kind]
    return FUNCTIONS[kind](*(_expression(operand) for operand in rest))


# ------------------------------------------------------------------------------------------------------------------
# The cache of derived models: derivation is the slow part of loading a robot that was compiled before.
# ------------------------------------------------------------------------------------------------------------------


def recall(spec: RobotSpec, identity: Identity, words: Sequence[str]) -> DerivedModel | None:
    """The derived model of a robot from the cache, None if it is not there.

    A cached model is used if ``identity`` (the content of the robot file), ``words`` (which functions), and the version
    of rrrgen agree. The cache holds all fields except ``spec``, which is taken from the caller.
    """
    field_values = _load(_file(spec, identity, words))
    return None if field_values is None else DerivedModel(spec=spec, **field_values)


def store(model: DerivedModel, identity: Identity, words: Sequence[str], functions: Sequence[ModelFunction]) -> None:
    """Keep those ``functions`` of a derived model for :func:`recall`, unless the cache is full or read-only."""
    part = _part(model, functions)
    kept = {field.name: getattr(part, field.name) for field in fields(part) if field.name != "spec"}
    with contextlib.suppress(OSError, StorageError):
        keep(_file(model.spec, identity, words), dumps(kept))


def _file(spec: RobotSpec, identity: Identity, words: Sequence[str]) -> str:
    return f"{spec.name}-{digest(identity.model_hash, *words, compiler_hash(), sp.__version__)[:24]}.derived"


def _load(name: str) -> dict[str, Any] | None:
    data = recall_bytes(name)
    try:
        return None if data is None else loads(data)
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
        return None  # not the format of this version; the model is derived again and replaces it
