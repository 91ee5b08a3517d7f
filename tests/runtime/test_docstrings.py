"""Docstrings of the public Python surface: every argument and every field is named, nothing only points elsewhere."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import rrrgen
from rrrgen import derive
from rrrgen.base import errors
from rrrgen.derive import derive_once
from rrrgen.derive.closed_forms import ClosedForm
from rrrgen.emit import package
from rrrgen.ik.inverse_kinematics import InverseKinematics
from rrrgen.ik.results import IKBatch, IKResult
from rrrgen.robot import file as robotfile
from rrrgen.runtime import load, results
from rrrgen.runtime.engines import BoundFunction

PYTHON_NAMES = {"base_parameters": "base_parameters_of"}
"""Methods with another name than the function in C and CasADi: ``base_parameters`` are the expressions of a model."""


def surface() -> dict[str, object]:
    """What a user imports or is handed, by its name."""
    found = {f"rrrgen.{name}": getattr(rrrgen, name) for name in rrrgen.__all__ if name != "__version__"}
    found |= {f"robotfile.{name}": getattr(robotfile, name) for name in robotfile.__all__}
    for module in (derive, package, load, errors, results):
        for name, thing in inspect.getmembers(module):
            defined = inspect.isfunction(thing) or inspect.isclass(thing)
            if defined and thing.__module__ == module.__name__ and not name.startswith("_"):
                found[f"{module.__name__}.{name}"] = thing
    return found | {kind.__name__: kind for kind in (BoundFunction, ClosedForm, InverseKinematics, IKResult, IKBatch)}


def arguments(function: object) -> list[str]:
    parameters = inspect.signature(function).parameters.values()  # type: ignore[arg-type]
    return [p.name for p in parameters if p.name not in ("self", "cls")]


def own(kind: type) -> Iterator[tuple[str, object]]:
    """Public methods and properties that the package defines for a class, those of its bases included."""
    for name, member in inspect.getmembers(kind):
        if name.startswith("_"):
            continue
        home = next(base for base in kind.__mro__ if name in vars(base))
        if home.__module__.startswith("rrrgen") and (inspect.isfunction(member) or isinstance(member, property)):
            yield name, member


def documents() -> Iterator[tuple[str, str, list[str]]]:
    """Name, docstring and the arguments or fields that it has to name."""
    for name, thing in surface().items():
        if inspect.isclass(thing):
            fields = list(getattr(thing, "__dataclass_fields__", getattr(thing, "_fields", ())))
            made = [] if fields or "__init__" not in vars(thing) else arguments(vars(thing)["__init__"])
            yield name, inspect.getdoc(thing) or "", fields or made
            for method, member in own(thing):
                taken = [] if isinstance(member, property) else arguments(member)
                yield f"{name}.{method}", inspect.getdoc(member) or "", taken
        else:
            yield name, inspect.getdoc(thing) or "", arguments(thing)


DOCUMENTS = {name: (text, named) for name, text, named in documents()}


def names(text: str, argument: str) -> bool:
    """Whether ``text`` explains ``argument``: in a line of its own, ``argument: meaning``, or in code quotes."""
    return bool(
        re.search(rf"^\s*{argument}: \S", text, re.M)
        or any(re.search(rf"\b{argument}\b", code) for code in re.findall(r"``(.+?)``", text, re.S))
    )


def test_the_test_finds_what_is_missing():
    assert len(DOCUMENTS) > 100
    assert {"rrrgen.Model.forward_dynamics", "rrrgen.compile", "InverseKinematics.solve_batch"} <= set(DOCUMENTS)
    text, named = DOCUMENTS["rrrgen.Model.forward_dynamics"]
    assert set(named) >= {"q", "dq", "tau", "beta", "Ia", "with_status"}
    assert not names(re.sub(r"^\s*beta: .*$", "", text, flags=re.M), "beta")
    assert not names("q: joint positions", "dq")
    assert not names("what is said of a q in passing", "q")


def test_no_module_hides_an_exported_name():
    """Importing the module ``rrrgen.x`` replaces a function ``rrrgen.x``."""
    modules = {path.stem for path in Path(rrrgen.__file__).parent.iterdir()}
    assert not modules & set(rrrgen.__all__)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_argument_is_explained(name):
    text, named = DOCUMENTS[name]
    assert text, "no docstring"
    assert [argument for argument in named if not names(text, argument)] == []
    assert not re.match(r"(See|As|Like) (:|the |``)", text), "a docstring says what the thing is"


def test_functions_of_the_model_state_shapes_and_units():
    for name in derive_once(rrrgen.load_spec("rrr")).programs:
        if not name.endswith("_nominal"):
            text, _ = DOCUMENTS[f"rrrgen.Model.{PYTHON_NAMES.get(name, name)}"]
            assert "Returns:" in text
            assert "(..." in text.partition("Returns:")[2], f"{name}: the shape of the result"
            lines = re.findall(r"^\s*(q|dq|ddq|tau|beta|Ia): (.*(?:\n {8,}.*)*)", text, re.M)
            assert all("(..., n)" in line or "(..., b)" in line for _, line in lines), name
            assert all(re.search(r"rad|N m|SI units|kg", line) for _, line in lines), name
