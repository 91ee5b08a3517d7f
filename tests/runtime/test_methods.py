"""The methods that are made from the table of model functions, and their stub."""

from __future__ import annotations

import ast
import inspect
import linecache
from pathlib import Path

import numpy as np
import pytest

import rrrgen
from rrrgen.derive.functions.table import GROUPS, TABLE
from rrrgen.runtime.functions import table_functions
from rrrgen.runtime.functions.methods import made_functions, stub

STUB = Path(table_functions.__file__).with_suffix(".pyi")


def test_the_stub_is_up_to_date():
    assert STUB.read_text(encoding="utf-8") == stub(), "make stubs writes it"


def parameters(function: ast.FunctionDef) -> list[tuple[str, str, bool]]:
    """Name, kind and whether there is a default, of every parameter of a function of the stub."""
    places, keywords = function.args, inspect.Parameter.KEYWORD_ONLY.name
    given = len(places.args) - len(places.defaults)
    return [
        *((arg.arg, inspect.Parameter.POSITIONAL_OR_KEYWORD.name, k >= given) for k, arg in enumerate(places.args)),
        *(
            (arg.arg, keywords, value is not None)
            for arg, value in zip(places.kwonlyargs, places.kw_defaults, strict=True)
        ),
    ]


def test_the_stub_and_the_methods_agree():
    """In names, order, kinds and defaults of parameters, also of every overload; `make types` checks the types."""
    (stated,) = (node for node in ast.parse(stub()).body if isinstance(node, ast.ClassDef))
    functions = [node for node in stated.body if isinstance(node, ast.FunctionDef)]
    assert {function.name for function in functions} == {function.name for function in made_functions()}
    for function in functions:
        made = inspect.signature(inspect.getattr_static(rrrgen.Model, function.name)).parameters.values()
        expected = [(p.name, p.kind.name, p.default is not inspect.Parameter.empty) for p in made]
        overloaded = any(isinstance(word, ast.Name) and word.id == "overload" for word in function.decorator_list)
        found = parameters(function)
        assert [row[:2] for row in found] == [row[:2] for row in expected], function.name
        if not overloaded:
            assert found == expected, function.name


def test_every_function_is_a_method():
    hand = {function.name for function in TABLE if function.by_hand}
    of_hessians = ("inverse_dynamics", "forward_dynamics", "floating_inverse_dynamics")
    with_matrices = {f"{name}_hessian" for name in of_hessians}  # packed in C, symmetric in Python
    assert hand == {"base_parameters", "add_payload", "add_payload_at", "friction", *with_matrices}
    for function in made_functions():
        method = inspect.getattr_static(rrrgen.Model, function.name)
        assert method.__qualname__ == f"TableFunctions.{function.name}"
        assert method.__module__ == table_functions.__name__
        assert ast.get_docstring(ast.parse(inspect.cleandoc(f'"""{method.__doc__}"""'))) == inspect.getdoc(method)


def test_groups_are_described():
    assert list(GROUPS) == list(dict.fromkeys(function.group for function in TABLE))


def test_tracebacks_show_the_line_of_a_method():
    code = rrrgen.Model.inverse_dynamics.__code__
    assert "inverse_dynamics" in linecache.getline(code.co_filename, code.co_firstlineno)


def test_arguments_are_positional_until_those_by_keyword():
    model = rrrgen.compile("pendulum", backend="numpy")
    with pytest.raises(TypeError, match="positional"):
        model.inverse_dynamics([0.1], [0.2], [0.3], None, np.zeros(3))
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'ddq'"):
        model.inverse_dynamics([0.1], [0.2])
