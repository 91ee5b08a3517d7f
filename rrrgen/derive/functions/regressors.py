"""Recorders of the regressors, which do not depend on inertial parameters.

Equation numbers (14.x) are those of Kostic, de Jager and Steinbuch, chapter 14 of the Robotics and Automation Handbook
(CRC Press, 2005).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import sympy as sp

from rrrgen.derive.functions.dynamics import Frames, block_frames_first, link_frames_only
from rrrgen.derive.functions.recording import FunctionBuilder
from rrrgen.derive.parameters.listing import TENSOR
from rrrgen.derive.recursions import mass_matrix_and_gravity as composite
from rrrgen.derive.recursions.drive_inertia import inertia_columns, virtual_work
from rrrgen.derive.recursions.linear_algebra import dot, flat
from rrrgen.derive.recursions.link_frames import Chain
from rrrgen.derive.recursions.pseudo_inertia import from_standard
from rrrgen.derive.recursions.regressor import (
    all_parameters,
    columns_by_axes,
    columns_passed_down,
    virtual_power,
)
from rrrgen.derive.recursions.velocities_and_accelerations import LinkMotion, forward
from rrrgen.program import Port, Program
from rrrgen.robot.spec import STANDARD


def regressor_rows(r: FunctionBuilder, columns: list[list[Any]], drives: list[list[Any]]) -> list[list[Any]]:
    """Convert the columns of Y for the compiler's base parameters to the rows of Y, (n, b + drives), for beta.

    ``drives`` are the columns of the drive inertias. On a floating base there are 6 + n rows.
    """
    inverse = r.parametrization.inverse
    if inverse is None:
        return [list(row) for row in zip(*columns, *drives, strict=True)]
    rows = [_through(r, inverse, list(row)) for row in zip(*columns, strict=True)]
    return [[*row, *(column[j] for column in drives)] for j, row in enumerate(rows)]


def _through(r: FunctionBuilder, inverse: tuple[tuple[sp.Expr, ...], ...], values: list[Any]) -> list[Any]:
    """The row vector ``values`` times the matrix ``inverse``."""
    result: list[Any] = [0] * len(inverse[0])
    for row, value in zip(inverse, values, strict=True):
        for m, factor in enumerate(row):
            if factor != 0:
                result[m] = result[m] + r.constant(factor) * value
    return result


def _motions(r: FunctionBuilder, *further: str) -> tuple[Chain, list[LinkMotion]]:
    chain = r.chain_in_gravity("dq", "ddq", *further)
    dq, ddq = r.joints("dq"), r.joints("ddq")
    return chain, forward(chain, dq, ddq, [True] * chain.n)


def regressor(columns: Callable[..., list[list[Any]]], frames: Frames) -> Callable[[FunctionBuilder], Program]:
    """Make a recorder of Y (n, b + drives) with tau = Y(q, dq, ddq) beta. (14.10)

    ``columns`` is the method that computes the columns of Y for canonical parameters; ``frames`` chooses the frame in
    which each link is computed.
    """

    def record(r: FunctionBuilder) -> Program:
        chain = r.chain_in_gravity("dq", "ddq")
        dq, ddq = r.joints("dq"), r.joints("ddq")
        canonical = columns(chain, dq, ddq, frames(chain), r.parametrization.basis.parameters)
        rows = regressor_rows(r, canonical, inertia_columns(r.model.spec, ddq))
        then = ", then of the drive inertias" if r.drives else ""
        port = Port("Y", (r.n, len(rows[0])), "SI", "", f"columns in the order of the base parameters{then}")
        return r.builder.program(
            "regressor",
            [(port, flat(rows))],
            "Regressor in the base parameters.",
            "tau = Y(q, dq, ddq) beta   (14.10)",
        )

    return record


def regressor_transpose(r: FunctionBuilder) -> Program:
    """Record r = Y(q, dq, ddq)' e, shape (b + drives,), for a vector e (n,), without forming Y. (14.23)"""
    chain, motions = _motions(r, "e")
    e = r.joints("e")
    virtual = composite.velocities(chain, e)
    in_link_frame = [True] * chain.n
    values = [virtual_power(chain, motions, in_link_frame, virtual, p) for p in r.parametrization.basis.parameters]
    inverse = r.parametrization.inverse
    if inverse is not None:
        values = _through(r, inverse, values)
    values += virtual_work(r.model.spec, r.joints("ddq"), e)
    port = Port("r", (len(values),), "SI", "", "Y' e")
    return r.builder.program(
        "regressor_transpose",
        [(port, values)],
        "Transposed base regressor times a vector, for adaptive laws; Y is never formed.",
        "r = Y(q, dq, ddq)' e   (14.23)",
    )


def standard_regressor(r: FunctionBuilder) -> Program:
    """Record Y (n, 10 n + drives) with tau = Y(q, dq, ddq) phi, for standard parameters about the link frames."""
    chain = r.chain_in_gravity("dq", "ddq")
    dq, ddq = r.joints("dq"), r.joints("ddq")
    canonical = columns_by_axes(chain, dq, ddq, [True] * chain.n, all_parameters(chain.n))
    columns = []
    for i, X in enumerate(chain.link_frames):
        entries = canonical[len(STANDARD) * i : len(STANDARD) * (i + 1)]
        for k in range(len(STANDARD)):
            factors = from_standard([int(k == m) for m in range(len(STANDARD))]).transform(X).entries()
            columns.append([dot(factors, values) for values in zip(*entries, strict=True)])
    columns += inertia_columns(r.model.spec, ddq)
    rows = [[column[j] for column in columns] for j in range(r.n)]
    then = "; then the drive inertias" if r.drives else ""
    port = Port("Y", (r.n, len(columns)), "SI", "", "per link: " + ", ".join(STANDARD) + then)
    return r.builder.program(
        "standard_regressor",
        [(port, flat(rows))],
        "Regressor in the standard parameters.",
        "tau = Y(q, dq, ddq) phi",
        [f"Inertia tensors about the origin of the link frame, in its axes: {TENSOR}."],
    )


REGRESSOR = tuple(
    regressor(columns, frames)
    for columns in (columns_by_axes, columns_passed_down)
    for frames in (link_frames_only, block_frames_first)
)
