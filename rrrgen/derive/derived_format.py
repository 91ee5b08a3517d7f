"""The JSON format of derived models: pure data, so that reading a file never executes anything.

Numbers, strings, None and tuples (as JSON lists) are written directly; everything else is an object with one key:
``dict`` (a list of pairs), ``ratio`` (a fraction "p/q"), ``expr`` (an expression), ``role`` or ``domain`` (of a port),
``program``, or another of :data:`RECORDS` with the list of its fields. The nodes of a program are stored as three
columns: operations, operands and values.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import fields
from fractions import Fraction
from itertools import chain
from typing import Any

import sympy as sp

from rrrgen.derive.parameters.base_parameters import BaseParameter, Regrouping
from rrrgen.program import OperationCount, Port, Program
from rrrgen.program.nodes import ARITY, Node, Op
from rrrgen.program.passes.interface import PassReport
from rrrgen.program.ports import Domain, Failure, Role, Status

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
        return ["symbol", expression.name, _assumed(expression)]
    if isinstance(expression, sp.Rational):
        return int(expression) if expression.is_Integer else ["number", f"{expression.p}/{expression.q}"]
    if isinstance(expression, sp.Float):
        raise TypeError("floating-point numbers are not kept in expressions")
    name = str(expression) if expression.is_NumberSymbol else type(expression).__name__
    if name not in (CONSTANTS if expression.is_NumberSymbol else FUNCTIONS):
        raise TypeError(f"{name} is not kept in expressions")
    return [name, *(_plain_expression(operand) for operand in expression.args)]


def _assumed(symbol: sp.Symbol) -> dict[str, bool]:
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
