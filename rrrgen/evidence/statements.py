"""What header and manifest of emitted code say about rounding errors, and what a verification finds about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import ROUND_CEILING, Context
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.emit.interface import RoundingStatement
from rrrgen.evidence.boxes import Ranges, acceleration_range, box_of, nominal_beta
from rrrgen.evidence.residual import residual_bounds, solved_with
from rrrgen.evidence.rounding import DOUBLE, FLOAT, NoBoundError, rounding_bounds
from rrrgen.evidence.sampling import RESOLUTION, has_wide_format, largest_errors, largest_residuals
from rrrgen.program import Role
from rrrgen.verify.report import Row

if TYPE_CHECKING:
    from rrrgen.base.parallel import Tell
    from rrrgen.emit import Real
    from rrrgen.program import Program
    from rrrgen.runtime.engines import Engine
    from rrrgen.runtime.model import Model

Array = NDArray[Any]


def statement(program: Program, entry: Mapping[str, Any], real: Real) -> RoundingStatement:
    """The statement about ``program`` in code of the number type ``real``.

    ``entry`` is the entry ``rounding`` of the certificate, from :func:`rrrgen.evidence.certificate.rounding_entry`: its
    bounds and their box, or the reason why there are none. The sentence has the largest bound of every output in its
    unit, rounded up; the data have one bound per element and the box.
    """
    if "none" in entry:
        return RoundingStatement(f"Rounding errors: no bound; {entry['none']}.", {"none": entry["none"]})
    stated = entry[real]
    if "quantity" in entry:
        unit = next(port.unit for port in program.inputs if port.role is Role.TORQUE)
        (bounds,) = stated["bounds"].values()
        sentence = (
            f"Residual |M ddq - (tau - c - g)| at most {rounded_up(max(bounds))} {unit}, with exact M, c and g; proven "
            "where the status is ok, for any torques, and q, dq and ddq in the box that manifest.json states."
        )
        return RoundingStatement(
            sentence, {"quantity": entry["quantity"], "box": stated["box"], "bounds": stated["bounds"]}
        )
    worst = {port.name: max(stated["bounds"][port.name], default=0.0) for port in program.outputs}
    errors = ", ".join(f"{name} {rounded_up(bound)}" for name, bound in worst.items())
    sentence = f"Rounding errors at most: {errors}; proven for inputs in the box that manifest.json states."
    data = {"box": stated["box"], "bounds": stated["bounds"]}
    if "conditional" in entry:
        names = ", ".join(entry["conditional"]["outputs"])
        sentence += f" Those of {names} hold where all comparisons come out as in exact arithmetic."
        data["conditional"] = entry["conditional"]
    if "assumption" in entry:
        sentence += f" It is assumed that {entry['assumption']}."
        data["assumption"] = entry["assumption"]
    return RoundingStatement(sentence, data)


def statements(
    programs: Mapping[str, Program], entries: Mapping[str, Mapping[str, Any]], real: Real
) -> dict[str, RoundingStatement]:
    """The statements about all ``programs``, by name; see :func:`statement`."""
    return {name: statement(programs[name], entry, real) for name, entry in entries.items()}


def rounding_rows(
    model: Model, ranges: Ranges, samples: int, seed: int, tell: Tell | None = None
) -> tuple[list[Row], list[tuple[str, str]]]:
    """Compare the errors of a compiled ``model`` with their proven bounds, at random states and by a search uphill.

    The box is that of the robot file's limits and ``ranges``; half of the states have their rates at its corners. The
    difference of a row is the largest error found over its bound, of all output elements, so the tolerance is 1 but for
    the resolution of the figures. Errors are those of the compiled code where the model is compiled, and else of the
    same operations in NumPy.

    Returns the rows, and what has no bound with the reason.
    """
    real: Real = "double" if model.engine.dtype == np.float64 else "float"
    precision = DOUBLE if real == "double" else FLOAT
    if not has_wide_format(precision):
        return [], [("rounding bounds", "this machine has no format with more digits than double")]
    rows, skipped = [], []
    programs = {name: (program, part) for part in model.parts for name, program in part.derived.programs.items()}
    for done, (name, (program, part)) in enumerate(programs.items()):
        if tell is not None:
            tell(done, len(programs), f"rounding of {name}")
        box = box_of(program, model.spec, nominal_beta(model.derived), ranges)
        compiled = partial(_called, part.engine, program) if part.engine.name == "c" else None
        others = solved_with(part.derived.programs, name)
        reference = "proven rounding bound" if others is None else "proven bound of the residual"
        try:
            if others is None:
                proven = rounding_bounds(program, {port: each.bounds for port, each in box.items()})
                rows_of = proven.double if real == "double" else proven.single
                bounds = np.array([bound for row in rows_of for bound in row])
                found = largest_errors(
                    program, box, precision, samples, seed, compiled=compiled, conditional=proven.conditional
                )
            else:
                box["ddq"] = acceleration_range(model.spec, ranges)
                residual = residual_bounds(
                    program, *others, {port: each.bounds for port, each in box.items()}, box["ddq"].upper
                )
                bounds = np.array(residual.double if real == "double" else residual.single)
                found = largest_residuals(program, *others, box, precision, samples, seed, compiled=compiled)
        except NoBoundError as reason:
            skipped.append((f"rounding of {name}", str(reason)))
            continue
        shares = np.divide(found, bounds, out=np.where(found > 0.0, np.inf, 0.0), where=bounds > 0.0)
        note = f"error {found.max(initial=0.0):.2g}, bound {rounded_up(float(bounds.max(initial=0.0)))}"
        share = float(shares.max(initial=0.0))
        rows.append(Row(name, reference, "box of limits", samples, share, RESOLUTION, note))
    return rows, skipped


def _called(engine: Engine, program: Program, states: Sequence[Array]) -> Sequence[Array]:
    """The outputs of ``program`` by ``engine`` for values (states, size) of every input port."""
    given = [state.reshape(len(state), *port.shape) for state, port in zip(states, program.inputs, strict=True)]
    return engine.call(program.name, given)


def rounded_up(bound: float) -> str:
    """The number ``bound`` with two digits, never less than it is: "3.9e-13" for 3.81e-13."""
    return f"{float(Context(prec=2, rounding=ROUND_CEILING).create_decimal_from_float(bound)):.1e}"
