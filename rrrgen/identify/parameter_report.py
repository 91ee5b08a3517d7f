"""The identified parameters as lines of text: values, standard deviations, units and the meaning of the names."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rrrgen.identify.identification import Identification

LONGEST = 40
"""Longest name (characters) printed in the row of its numbers; a longer one gets a line of its own."""


def parameter_lines(found: Identification) -> Iterator[str]:
    """Lines of the parameter table, of its legend, and of the essential parameters if they were computed."""
    delivered, estimate = found.delivered, found.estimate
    width = max(9, min(LONGEST, max(len(name) for name in estimate.names)))
    unit = max(4, max(len(text) for text in found.units))
    beside = delivered.x is not estimate.x
    head = f"{'parameter':>{width}} {'unit':<{unit}} {'value':>12} {'std':>9}"
    yield head + (f"   {'unconstrained':>13} {'std':>9}" if beside else "")
    for i, name in enumerate(estimate.names):
        if len(name) > width:
            yield f"  {name}"
        line = f"{name if len(name) <= width else '':>{width}} {found.units[i]:<{unit}} {delivered.x[i]:12.6g} "
        line += f"{'at bound':>9}" if delivered.at_bound[i] else f"{delivered.std[i]:9.2e}"
        yield line + (f"   {estimate.x[i]:13.6g} {estimate.std[i]:9.2e}" if beside else "")
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
