"""Makes the methods of a model from the table of model functions: signature, docstring, body, and the stub for editors.

The text of every method is compiled once, when the first model is made. A method thus costs what one written by hand
does, and tracebacks show its lines.
"""

from __future__ import annotations

import linecache
import math
import re
import sys
import textwrap
from collections.abc import Iterator
from typing import Any

from rrrgen.derive.functions.model_function import ArgumentKind, ModelFunction, Needs
from rrrgen.derive.functions.table import ALWAYS, FUNCTIONS, TABLE

WIDTH = 120
"""Longest line of a docstring and of the stub."""

INDENT = " " * 4

PARAMETERS = ("beta", "Ia", "gravity")
"""Arguments that choose the program; the other arguments are inputs of it."""

FROM_FILE = {
    "friction": "self.friction_parameters if friction is None else friction",
    "tau_max": "self._largest_torques(tau_max)",
    "rotor_inertia": "self._drive('inertia', rotor_inertia)",
    "stiffness": "self._drive('stiffness', stiffness)",
    "damping": "self._drive('damping', damping, 0.0)",
}
"""Expressions for the arguments that the robot file can give."""


def add_methods(owner: type) -> None:
    """Give the class ``owner`` a method for every function of the table that has none written by hand."""
    definitions = "\n\n".join(definition(function) for function in made_functions())
    text, file = f"from __future__ import annotations\n\n\n{definitions}", "<methods of rrrgen.Model>"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    from rrrgen.runtime import results

    scope: dict[str, Any] = {**vars(results), "__name__": owner.__module__, "inf": math.inf}
    exec(compile(text, file, "exec"), scope)
    for function in made_functions():
        method = scope[function.name]
        method.__qualname__ = f"{owner.__qualname__}.{function.name}"
        setattr(owner, function.name, method)


def made_functions() -> tuple[ModelFunction, ...]:
    """The functions of the table whose methods are made from it."""
    return tuple(function for function in TABLE if not function.by_hand)


def definition(function: ModelFunction) -> str:
    """The text of the method of ``function``."""
    lines = [*_signature(function), textwrap.indent(f'"""{docstring(function)}\n"""', INDENT), *_body(function)]
    return "\n".join(lines) + "\n"


def stub() -> str:
    """The stub of the module that holds the methods, for type checkers and editors."""
    used = sorted({function.result for function in made_functions() if function.result})
    head = [
        '"""The methods of a model that are made from the table of model functions. Written by `make stubs`."""\n',
        "from typing import Any, Literal, overload\n",
        "from numpy.typing import ArrayLike\n",
        "from rrrgen.runtime.functions.calls import Array, Calls",
        "from rrrgen.runtime.results import (",
        *(f"{INDENT}{name}," for name in used),
        ")\n",
        "class TableFunctions(Calls):",
        f'{INDENT}"""Methods for the functions of the model."""\n',
    ]
    methods = [_stub_of(function) for function in made_functions()]
    parts = [text if text.endswith(" ...\n") else f"{text}\n" for text in methods]  # as ruff formats stubs
    return "\n".join(head) + "\n" + textwrap.indent("".join(parts).rstrip("\n"), INDENT) + "\n"


def _stub_of(function: ModelFunction) -> str:
    """The signatures of one method in the stub: of a function with a status, one for each kind of result."""
    document = textwrap.indent(f'"""{docstring(function, len(INDENT))}\n"""', INDENT)
    moving = _on_moving_base(function)
    kind = function.result or "Array"
    kinds = {"": kind}
    if function.status:
        kinds = {"Literal[False] = ...": kind, "Literal[True]": f"tuple[{kind}, Array]"}
        kinds["bool"] = " | ".join(kinds.values())
    elif moving is None:
        return "\n".join([*_signature(function), document]) + "\n"
    first, *others = (["@overload", *_signature(function, *of, "None = None")] for of in kinds.items())
    if moving is not None:
        returned = "Any" if function.status else moving.result or "Array"
        others.append(["@overload", *_signature(function, "bool = False", returned, "ArrayLike")])
    overloads = [[*first, document], *([*lines[:-1], f"{lines[-1]} ..."] for lines in others)]
    return "\n".join("\n".join(lines) for lines in overloads) + "\n"


def _signature(
    function: ModelFunction,
    with_status: str = "bool = False",
    returned: str = "",
    of_base: str = "ArrayLike | None = None",
) -> list[str]:
    """The lines of the signature of ``function``'s method; ``of_base`` is the type of what describes a moving base."""
    arguments = ["self", *(_argument(q) for q in function.arguments if q not in function.keywords)]
    moving = _on_moving_base(function)
    keywords = [_argument(q) for q in function.keywords]
    keywords += [f"{q.name}: {of_base}" for q in _of_base(function)]
    if function.of_tip:
        keywords.append("tip: str | None = None")
    if function.status:
        keywords.append(f"with_status: {with_status}")
    arguments += ["*", *keywords] if keywords else []
    kind = returned or ("Any" if function.status or moving else function.result or "Array")
    short = f"def {function.name}({', '.join(arguments)}) -> {kind}:"
    if len(INDENT) + len(short) + len(" ...") <= WIDTH:
        return [short]
    return [f"def {function.name}(", *(f"{INDENT}{argument}," for argument in arguments), f") -> {kind}:"]


def _on_moving_base(function: ModelFunction) -> ModelFunction | None:
    """The function that ``function`` is on a floating base that moves, if there is one."""
    moving = FUNCTIONS.get(f"floating_{function.name}")
    return moving if moving is not None and "orientation" in moving.takes.split() else None


def _of_base(function: ModelFunction) -> tuple[ArgumentKind, ...]:
    """What describes the moving base: the arguments that ``function`` has besides its own on a floating base."""
    moving, names = _on_moving_base(function), {q.name for q in function.arguments}
    return tuple(q for q in moving.arguments if q.name not in names) if moving else ()


def _longer(function: ModelFunction, q: ArgumentKind) -> str:
    """The sentence on the shape that the argument ``q`` of ``function`` has on a floating base, if it is another."""
    moving = _on_moving_base(function)
    other = next((argument for argument in moving.arguments if argument.name == q.name), q) if moving else q
    if other.shape == q.shape:
        return ""
    return f" Of a floating base that moves: {other.meaning}, (..., {', '.join(_sizes(other))}){other.note}."


def _argument(q: ArgumentKind) -> str:
    if q.default is not None:
        return f"{q.name}: ArrayLike = {q.default!r}"
    return f"{q.name}: ArrayLike | None = None" if q.from_file or q.optional else f"{q.name}: ArrayLike"


# -- docstrings --------------------------------------------------------------------------------------------------


def docstring(function: ModelFunction, margin: int = 0) -> str:
    """The docstring of ``function``'s method, in lines that leave room for the indentation and ``margin``."""
    width = WIDTH - len(INDENT) - margin
    entries = [f"{q.name}: {describe_argument(q)}{_longer(function, q)}" for q in function.arguments]
    entries += [f"{q.name}: of a floating base that moves: {describe_argument(q)}" for q in _of_base(function)]
    if function.of_tip:
        entries.append("tip: a named tip of the robot file in place of the unnamed one.")
    if function.status:
        kinds = " or ".join(dict.fromkeys(kind.removeprefix("numpy.linalg.") for kind, _ in _errors(function)))
        entries.append(f"with_status: return ``(result, status)`` instead of raising {kinds}.")
    parts = [_wrap(function.summary, width - 3)]
    parts += [_wrap(paragraph, width) for paragraph in function.details.split("\n\n") if paragraph]
    parts.append(_section("Args", entries, width))
    moving = _on_moving_base(function)
    on_base = f" Of a floating base that moves, what :meth:`{moving.name}` returns." if moving else ""
    refused = f" Where the input is refused the status, (...), is 2; {function.refuses}." if function.refuses else ""
    parts.append(
        "Returns:\n" + textwrap.indent(_wrap(function.returns + on_base + refused, width - len(INDENT)), INDENT)
    )
    if errors := _errors(function):
        parts.append(_section("Raises", [f"{kind}: {text}" for kind, text in errors], width))
    return "\n\n".join(parts)


def _errors(function: ModelFunction) -> list[tuple[str, str]]:
    """The errors that ``function``'s method raises: kind and condition."""
    errors = list(function.raises)
    if function.refuses:
        errors.append(("ValueError", "an input is not finite or out of its range, and ``with_status`` is False."))
    if function.of_tip and not any(kind == "ValueError" for kind, _ in function.raises):
        errors.append(("ValueError", "the robot has no tip of this name."))
    return errors


def describe_argument(q: ArgumentKind) -> str:
    """A sentence about an argument: meaning, shape, unit, default."""
    shape = "(...)" if not q.shape else f"(..., {', '.join(_sizes(q))})"
    if q.constant:
        single = ", ".join(_sizes(q)) + ("," if len(_sizes(q)) == 1 else "")
        shape = f"({single}), {shape} or one number" if q.spread else f"({single}) or {shape}"
    units = {"SI": "SI units", "1": "", "1, m": "translation in m", "m, 1": "SI units", "any": "in any unit"}
    unit = units.get(q.unit, q.unit.replace(" | ", " or ").replace(", ", " and "))
    default = f"; by default {q.from_file}" if q.from_file else ""
    return f"{', '.join(filter(None, (q.meaning, shape, unit)))}{q.note}{default}."


def _sizes(q: ArgumentKind) -> list[str]:
    return [re.sub(r"(?<=\d)(?=[n(])", " ", size).replace("+", " + ") for size in q.shape.split()]


def _section(title: str, entries: list[str], width: int) -> str:
    lines = [textwrap.indent(_wrap(entry, width - len(INDENT), INDENT), INDENT) for entry in entries]
    return "\n".join([f"{title}:", *lines])


def _wrap(text: str, width: int, further: str = "") -> str:
    return textwrap.fill(text, width, subsequent_indent=further, break_long_words=False, break_on_hyphens=False)


# -- bodies ------------------------------------------------------------------------------------------------------


def _body(function: ModelFunction) -> Iterator[str]:
    """The statements of ``function``'s method."""
    if moving := _on_moving_base(function):
        given = ", ".join(f"{q.name}={q.name}" for q in moving.arguments)
        given += ", with_status=with_status" if function.status else ""
        asked = " or ".join(f"{q.name} is not None" for q in _of_base(function))
        yield f"{INDENT}if {asked}:"
        yield f"{INDENT * 2}return self.{moving.name}({given})"
    if function.of_tip:
        yield f"{INDENT}name = {function.name!r} if tip is None else self._at_tip({function.name!r}, tip)"
    if function.absent and function.group in ALWAYS:
        yield f"{INDENT}if not self._has({_name(function)}):"
        yield f"{INDENT * 2}raise ValueError({function.absent!r})"
    elif function.needs is Needs.FLOATING_BASE:
        yield f"{INDENT}if not self.spec.floating_base:"
        yield f"{INDENT * 2}raise ValueError({function.absent!r})"
    results = _evaluation(function)
    if function.status:
        yield f"{INDENT}*values, status = {results}"
        value = f"{function.result}(*values)" if function.result else "values[0]"
        if function.links_only and not function.result:
            value = f"self._of_links({value})"
        elif function.links_only:
            yield f"{INDENT}result = {value}"
            value = f"result._replace({function.links_only}=self._of_links(result.{function.links_only}))"
        yield f"{INDENT}return self._check_status({_name(function)}, {value}, status, with_status)"
    elif function.result and function.links_only:
        yield f"{INDENT}result = {function.result}(*{results})"
        yield f"{INDENT}return result._replace({function.links_only}=self._of_links(result.{function.links_only}))"
    elif function.result:
        yield f"{INDENT}return {function.result}(*{results})"
    else:
        yield f"{INDENT}return {f'self._of_links({results}[0])' if function.links_only else f'{results}[0]'}"


def _evaluation(function: ModelFunction) -> str:
    """The expression for all results of ``function``."""
    name, arguments = _name(function), function.arguments
    inputs = [q for q in arguments if q.name not in PARAMETERS]
    chosen = [q.name for q in arguments if q.name in PARAMETERS]
    places = [parameter if parameter in chosen else "None" for parameter in PARAMETERS]
    while places and places[-1] == "None":
        places.pop()
    given = "".join(f", {place}" for place in places)
    if not any(q.from_file or q in function.keywords for q in inputs):
        values = "".join(f"{_value(function, q)}, " for q in inputs)
        if chosen:
            return f"self._evaluate({name}, ({values.rstrip(' ')}){given})"
        engine = "self.engine" if function.group in ALWAYS and not function.on_demand else f"self._with({name}).engine"
        return f"{engine}.call({name}, ({values.rstrip(' ')}))"
    values = ", ".join(f"{q.name!r}: {_value(function, q)}" for q in inputs)
    return f"self._evaluate_by_name({name}, {{{values}}}{given})"


def _name(function: ModelFunction) -> str:
    """The expression for the name of the program: that of a named tip is chosen when the method is called."""
    return "name" if function.of_tip else repr(function.name)


def _value(function: ModelFunction, q: ArgumentKind) -> str:
    """The expression for one input."""
    if q.from_file:
        return FROM_FILE[q.name]
    if q.spread:
        return f"self._widths({q.name})"
    if q.rigid:
        return f"self._rigid({q.name!r}, {q.name})"
    if q.optional:
        return f"*self._loads({function.name!r}, {q.name})"
    if q.for_drives is not None:
        return f"self._append_drive_values({function.name!r}, {q.name}, {q.for_drives!r})"
    return q.name


if __name__ == "__main__":
    sys.stdout.write(stub())
