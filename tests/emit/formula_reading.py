"""Reads printed formulas back and computes them: the printers' oracle, sharing no code with them.

Every reader turns its markup into arithmetic text over Python's operators, which a small evaluator computes.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from xml.etree import ElementTree

GREEK_LETTERS = {"β": "beta", "τ": "tau", "π": "pi", "φ": "phi"}
_OPERATORS = {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
              ast.Pow: operator.pow, ast.USub: operator.neg, ast.UAdd: operator.pos}  # fmt: skip
_FUNCTIONS = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt, "tanh": math.tanh, "exp": math.exp,
              "sgn": lambda x: math.copysign(1.0, x) if x else 0.0, "abs": abs}  # fmt: skip


def compute(text: str, values: dict[str, float]) -> float:
    """The value of arithmetic text; ``c23`` is cos(q2 + q3) unless a value of that name is given."""
    return _compute(ast.parse(text, mode="eval").body, values)


def _compute(node: ast.expr, values: dict[str, float]) -> float:
    match node:
        case ast.BinOp():
            return _OPERATORS[type(node.op)](_compute(node.left, values), _compute(node.right, values))
        case ast.UnaryOp():
            return _OPERATORS[type(node.op)](_compute(node.operand, values))
        case ast.Constant():
            return float(node.value)  # type: ignore[arg-type]
        case ast.Call(func=ast.Name(id=name), args=[argument]):
            return _FUNCTIONS[name](_compute(argument, values))
        case ast.Name(id=name):
            if name in values:
                return values[name]
            if name == "pi":
                return math.pi
            wave = re.fullmatch(r"([cs])_?([1-9]+)", name)
            assert wave, name
            angle = sum(values[f"q{joint}"] for joint in wave[2])
            return math.cos(angle) if wave[1] == "c" else math.sin(angle)
    raise AssertionError(ast.dump(node))


def read_plain(text: str) -> str:
    """Plain text, possibly over several lines."""
    return " ".join(text.split()).replace("^", "**")


# -- MathML ------------------------------------------------------------------------------------------------------------


def read_mathml(markup: str) -> str:
    """Presentation MathML of one formula."""
    return _element(ElementTree.fromstring(f"<mrow>{markup}</mrow>"))


def _element(e: ElementTree.Element) -> str:
    parts = [_element(child) for child in e]
    match e.tag:
        case "mn":
            return e.text or ""
        case "mi":
            return GREEK_LETTERS.get(e.text or "", e.text or "")
        case "mo":
            return {"−": "-", "·": "*", "\u2062": "*", "\u2061": ""}.get(e.text or "", e.text or "")
        case "mrow":
            return "".join(parts) if len(parts) != 1 else parts[0]
        case "mfrac":
            return f"(({parts[0]})/({parts[1]}))"
        case "msqrt":
            return f"sqrt({''.join(parts)})"
        case "mover":
            return ("d" if parts[1] == "˙" else "dd") + parts[0]
        case "msub":
            return parts[0] + parts[1].replace(",", "")
        case "msup" if parts[0] in _FUNCTIONS:
            return f"RAISED{parts[1]}:{parts[0]}"  # the argument follows; see _raise
        case "msup":
            return f"({parts[0]})**({parts[1]})"
    raise AssertionError(e.tag)


def raise_functions(text: str) -> str:
    """``RAISED2:cos(x)`` as ``cos(x)**2``: the exponent stands at the name in print."""
    while match := re.search(r"RAISED(\d+):(\w+)\(", text):
        depth, end = 1, match.end()
        while depth:
            depth += (text[end] == "(") - (text[end] == ")")
            end += 1
        call = text[match.start(2) : end]
        text = f"{text[: match.start()]}({call})**{match[1]}{text[end:]}"
    return text


# -- LaTeX -------------------------------------------------------------------------------------------------------------

_TOKEN = re.compile(r"\\[a-zA-Z]+|\d+(?:\.\d+)?|[a-zA-Z]|[{}()^_,+\-]|\s+|\\,")


def read_latex(markup: str) -> str:
    """LaTeX of one formula: juxtaposition is a product."""
    tokens = [t for t in _TOKEN.findall(markup.replace(r"\left", "").replace(r"\right", "")) if not t.isspace()]
    text, rest = _sequence(tokens, None)
    assert not rest
    return text


def _sequence(tokens: list[str], closing: str | None) -> tuple[str, list[str]]:
    factors: list[str] = []
    text = ""
    while tokens and tokens[0] != closing:
        token = tokens[0]
        if token in "+-":
            text += "*".join(factors) + token
            factors, tokens = [], tokens[1:]
        elif token == r"\cdot":
            tokens = tokens[1:]
        else:
            factor, tokens = _factor(tokens)
            factors.append(factor)
    return text + "*".join(factors), tokens[1:] if closing else tokens


def _group(tokens: list[str]) -> tuple[str, list[str]]:
    assert tokens[0] == "{"
    return _sequence(tokens[1:], "}")


def _factor(tokens: list[str]) -> tuple[str, list[str]]:
    token, tokens = tokens[0], tokens[1:]
    if token == r"\frac":
        above, tokens = _group(tokens)
        below, tokens = _group(tokens)
        return _raised(f"(({above})/({below}))", tokens)
    if token == r"\sqrt":
        inside, tokens = _group(tokens)
        return _raised(f"sqrt({inside})", tokens)
    if token in (r"\sin", r"\cos", r"\tanh", r"\exp"):
        exponent = "1"
        if tokens[0] == "^":
            exponent, tokens = _group(tokens[1:])
        inside, tokens = _sequence(tokens[1:], ")")
        return f"({token[1:]}({inside}))**({exponent})", tokens
    if token == "(":
        inside, tokens = _sequence(tokens, ")")
        return _raised(f"({inside})", tokens)
    if token[0].isdigit():
        return _raised(token, tokens)
    return _raised(*_name(token, tokens))


def _name(token: str, tokens: list[str]) -> tuple[str, list[str]]:
    name = token.lstrip("\\")
    if token in (r"\dot", r"\ddot", r"\mathit", r"\boldsymbol"):
        inside, tokens = _group(tokens)
        name = {"dot": "d", "ddot": "dd"}.get(name, "") + inside.replace("*", "")
    if tokens and tokens[0] == "_":
        end = tokens.index("}")
        name += "".join(t for t in tokens[2:end] if t != ",")
        tokens = tokens[end + 1 :]
    return name, tokens


def _raised(base: str, tokens: list[str]) -> tuple[str, list[str]]:
    if tokens and tokens[0] == "^":
        exponent, tokens = _group(tokens[1:])
        return f"({base})**({exponent})", tokens
    return base, tokens
