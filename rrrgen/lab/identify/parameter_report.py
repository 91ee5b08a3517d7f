"""The identified parameters as lines of text: values, standard deviations, units and the meaning of the names."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rrrgen.base.tables import text_table

if TYPE_CHECKING:
    from rrrgen.lab.identify.identification import Identification

LINE = 118
"""Longest line of a file or pipe: a parameter that is a combination of many others has a long name."""


def parameter_lines(found: Identification, width: int | None = None) -> Iterator[str]:
    """Lines of the parameter table, of its legend, and of the essential parameters if they were computed.

    The table is folded to lines of ``width`` characters, :data:`LINE` by default.
    """
    delivered, estimate = found.delivered, found.estimate
    beside = delivered.x is not estimate.x
    rows = [("parameter", "unit", "value", "std", *(("unconstrained", "std") if beside else ()))]
    for i, name in enumerate(estimate.names):
        std = "at bound" if delivered.at_bound[i] else f"{delivered.std[i]:.2e}"
        free = (f"{estimate.x[i]:.6g}", f"{estimate.std[i]:.2e}") if beside else ()
        rows.append((name, found.units[i], f"{delivered.x[i]:.6g}", std, *free))
    yield from text_table(rows, width or LINE, indent="", right=range(2, 6))
    yield (
        f"value: {delivered.origin} estimate"
        + (", the one in robot.yaml; unconstrained: " + estimate.method if beside else "")
    )
    if beside:
        yield (
            "std of value: delta method at the constrained optimum, residuals correlated, the prior counted as an "
            "observation; drives at their bound of 0 do not move"
        )
    yield from (f"names: {meaning}" for meaning in found.meanings)
    yield from _essential(found)


def _essential(found: Identification) -> Iterator[str]:
    essential = found.essential
    if essential is None:
        return
    estimate = essential.estimate
    yield f"essential parameters: {len(estimate.names)} of {len(found.names)} ({essential.stopped_by})"
    for i, name in enumerate(estimate.names):
        yield f"  {name} = {estimate.x[i]:.6g} +- {estimate.std[i]:.2g} {found.units[essential.kept[i]]}"
    yield f"essential parameters alone: relative error {100 * estimate.relative_error:.3g} % of the rows fitted"
    yield f"left out, in this order: {', '.join(essential.dropped) or 'none'}"
