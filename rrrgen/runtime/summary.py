"""A short HTML summary of a compiled model, for notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model


def html_summary(model: Model) -> str:
    """HTML tables of the joints (nominal Denavit-Hartenberg rows in rad and m, limits) and the base parameters."""
    joints = [
        (name, kind, *map(_number, numbers), f"{_number(low)} .. {_number(high)}")
        for name, (kind, *numbers), low, high in zip(
            [row.name for row in model.spec.rows], model.spec.dh_table(), *_ends(model), strict=True
        )
    ]
    values = [""] * len(model.base_parameters) if model.beta is None else [_number(value) for value in model.beta]
    parameters = [
        (p.name, _mathematics(str(p.expression)), value, _mathematics(p.unit))
        for p, value in zip(model.derived.base_parameters, values, strict=True)
    ]
    return (
        f"<p><b>{escape(model.name)}</b>: {model.n} joints, {len(parameters)} base parameters, "
        f"{escape(model.spec.convention)} Denavit-Hartenberg convention</p>"
        + _table(("joint", "type", "alpha (rad)", "a (m)", "d (m)", "theta (rad)", "limits of q"), joints)
        + _table(("base parameter", "expression", "nominal value", "unit"), parameters)
    )


def _ends(model: Model) -> tuple[list[float], list[float]]:
    """Lower and upper position limits of the joints of all DH rows, rad or m, as the robot file states them."""
    known = {name: k for k, name in enumerate(model.joint_names)}
    lower, upper = [], []
    for row in model.spec.rows:
        k = known.get(row.name)
        ends = (row.limits.lower, row.limits.upper)
        lower.append(float(model.limits.lower[k]) if k is not None else -np.inf if ends[0] is None else ends[0])
        upper.append(float(model.limits.upper[k]) if k is not None else np.inf if ends[1] is None else ends[1])
    return lower, upper


def _mathematics(text: str) -> str:
    """Raise exponents: ``kg m^2`` becomes kg m², ``a2**2*m3`` becomes a2²·m3."""
    return text.replace("**2", "²").replace("^2", "²").replace("*", "·")


def _number(value: float) -> str:
    return f"{value:.6g}" if np.isfinite(value) else ("-" if value < 0 else "") + "&infin;"


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    titles = "".join(f"<th>{escape(title)}</th>" for title in head)
    lines = ("".join(f"<td>{cell if cell.endswith('infin;') else escape(cell)}</td>" for cell in row) for row in rows)
    return f"<table><tr>{titles}</tr>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"
