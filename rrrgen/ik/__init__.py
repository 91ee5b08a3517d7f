"""Inverse kinematics: a chain is classified, its closed form derived, and self-contained C, CasADi or text printed.

* :func:`plan`: what kind of solver a robot gets, how many solutions, which redundancy parameter, why none;
* :func:`sources`, :func:`manifest`: the emitted C and its data, for ``generate``;
* :func:`closed_form`: the equations as text and LaTeX; :func:`branch_function`: as CasADi Functions.

The compiled solver as NumPy functions is :mod:`rrrgen.runtime.inverse_kinematics`. Everything is imported on first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rrrgen.ik.classify import plan
    from rrrgen.ik.interpreters.casadi_branches import branch_function, branch_labels, branch_signs
    from rrrgen.ik.report import closed_form
    from rrrgen.ik.sources import manifest, sources

_HOMES = {
    "branch_function": "rrrgen.ik.interpreters.casadi_branches",
    "branch_labels": "rrrgen.ik.interpreters.casadi_branches",
    "branch_signs": "rrrgen.ik.interpreters.casadi_branches",
    "plan": "rrrgen.ik.classify",
    "closed_form": "rrrgen.ik.report",
    "manifest": "rrrgen.ik.sources",
    "sources": "rrrgen.ik.sources",
}

__all__ = [
    "branch_function",
    "branch_labels",
    "branch_signs",
    "closed_form",
    "manifest",
    "plan",
    "sources",
]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(home), name)


def __dir__() -> list[str]:
    return sorted(__all__)
