"""What header and manifest of emitted code say about rounding errors, and what a verification finds about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import ROUND_CEILING, Context
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.errors import InputError
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.emit.interface import RoundingStatement
from rrrgen.evidence.boxes import PortRange, Ranges, box_of, nominal_beta
from rrrgen.evidence.rounding import DOUBLE, FLOAT, NoBoundError, Precision, rounding_bounds
from rrrgen.evidence.sampling import RESOLUTION, Evaluator, has_wide_format, largest_errors
from rrrgen.evidence.solutions import Solution, solution_of
from rrrgen.program import Role
from rrrgen.verify.report import Row

if TYPE_CHECKING:
    from rrrgen.base.parallel import Tell
    from rrrgen.emit import Real
    from rrrgen.program import Program
    from rrrgen.robot.spec import RobotSpec
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
        return RoundingStatement(
            _of_residuals(program, stated),
            {"quantity": entry["quantity"], **{key: value for key, value in stated.items() if key in _OF_RESIDUALS}},
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


_OF_RESIDUALS = ("box", "bounds", "least_diagonal_of_M")


def _of_residuals(program: Program, stated: Mapping[str, Any]) -> str:
    """The sentence about bounds of residuals."""
    worst = {name: rounded_up(max(row)) for name, row in stated["bounds"].items()}
    where = "q, dq and ddq in the box that manifest.json states."
    if list(worst) == ["ddq"]:
        unit = next(port.unit for port in program.inputs if port.role is Role.TORQUE)
        return (
            f"Residual |M ddq - (tau - c - g)| at most {worst['ddq']} {unit}, with exact M, c and g; proven where the "
            f"status is ok, for any torques, and {where}"
        )
    least = (
        f", no diagonal entry of M is below {rounded_up(stated['least_diagonal_of_M'])}"
        if ("least_diagonal_of_M" in stated)
        else ""
    )
    return (
        f"Residuals at most: |M ddq - (tau - c - g)| {worst['ddq']}, |M dddq_dq + dtau_dq| {worst['dddq_dq']}, "
        f"|M dddq_dv + dtau_dv| {worst['dddq_dv']}, |M dddq_dtau - 1| {worst['dddq_dtau']}, with exact M, c, g, and "
        f"dtau_dq at the returned ddq; proven where the status is ok{least}, and the inputs, ddq and the diagonal of "
        "dddq_dtau are in the box that manifest.json states."
    )


def statements(
    programs: Mapping[str, Program], entries: Mapping[str, Mapping[str, Any]], real: Real
) -> dict[str, RoundingStatement]:
    """The statements about all ``programs``, by name; see :func:`statement`."""
    return {name: statement(programs[name], entry, real) for name, entry in entries.items()}


def rounding_rows(
    model: Model, ranges: Ranges, samples: int, seed: int, tell: Tell | None = None, only: Sequence[str] = ()
) -> tuple[list[Row], list[tuple[str, str]]]:
    """Compare the errors of a compiled ``model`` with their proven bounds, at random states and by a search uphill.

    The box is that of the robot file's limits and ``ranges``; half of the states have their rates at its corners. The
    difference of a row is the largest error found over its bound, of all output elements, so the tolerance is 1 but for
    the resolution of the figures. Errors are those of the compiled code where the model is compiled, and else of the
    same operations in NumPy. ``only`` names the functions if not all are wanted;
    raises InputError for a name that is none.

    Returns the rows, and what has no bound with the reason.
    """
    real: Real = "double" if model.engine.dtype == np.float64 else "float"
    precision = DOUBLE if real == "double" else FLOAT
    if not has_wide_format(precision):
        return [], [("rounding bounds", "this machine has no format with more digits than double")]
    rows, skipped = [], []
    programs = {name: (program, part) for part in model.parts for name, program in part.derived.programs.items()}
    derived = {name: program for name, (program, _) in programs.items()}
    if only:
        if unknown := [name for name in only if name not in programs]:
            hint = did_you_mean(unknown[0], programs) or "there are " + ", ".join(programs)
            raise InputError(f"no function '{unknown[0]}'; {hint}")
        programs = {name: programs[name] for name in only}
    for done, (name, (program, part)) in enumerate(programs.items()):
        if tell is not None:
            tell(done, len(programs), f"rounding of {name}")
        box = box_of(program, model.spec, nominal_beta(model.derived), ranges)
        compiled = partial(_call, part.engine, program) if part.engine.name == "c" else None
        search = partial(_of_rounding, program, box, real, samples, seed, compiled)
        attempts = [("proven rounding bound", search)]
        solution = solution_of(derived, name)  # M may be in another part than the function
        if solution is not None:
            search = partial(_of_solution, solution, model.spec, box, ranges, precision, samples, seed, compiled)
            attempts.insert(0 if solution.residual_first else 1, ("proven bound of the residual", search))
        reason = ""
        for reference, search in attempts:
            try:
                bounds, errors = search()
            except NoBoundError as fault:
                reason = str(fault)
                continue
            shares = np.divide(errors, bounds, out=np.where(errors > 0.0, np.inf, 0.0), where=bounds > 0.0)
            error, bound = (float(values.max(initial=0.0)) for values in (errors, bounds))
            note = f"error {error:.2g}, bound {rounded_up(bound)}" + (f", ratio {bound / error:.3g}" if error else "")
            share = float(shares.max(initial=0.0))
            rows.append(Row(name, reference, "box of limits", samples, share, RESOLUTION, note))
            break
        else:
            skipped.append((f"rounding of {name}", reason))
    return rows, skipped


def _of_rounding(
    program: Program,
    box: Mapping[str, PortRange],
    real: Real,
    samples: int,
    seed: int,
    compiled: Evaluator | None,
) -> tuple[Array, Array]:
    """The bounds of the rounding errors and the largest ones found, one for every output element."""
    proven = rounding_bounds(program, {port: port_range.bounds for port, port_range in box.items()})
    bounds = np.array([bound for row in (proven.double if real == "double" else proven.single) for bound in row])
    precision = DOUBLE if real == "double" else FLOAT
    return bounds, largest_errors(
        program, box, precision, samples, seed, compiled=compiled, conditional=proven.conditional
    )


def _of_solution(
    solution: Solution,
    spec: RobotSpec,
    box: Mapping[str, PortRange],
    ranges: Ranges,
    precision: Precision,
    samples: int,
    seed: int,
    compiled: Evaluator | None,
) -> tuple[Array, Array]:
    """Bounds of the residuals of a ``solution`` and the largest residuals found by search, one for every element."""
    box = solution.box(box, spec, ranges)
    rows = solution.bounds(box).bounds[precision]
    bounds = np.array([bound for row in rows.values() for bound in row])
    return bounds, solution.largest(box, precision, samples, seed, compiled)


def _call(engine: Engine, program: Program, states: Sequence[Array]) -> Sequence[Array]:
    """The outputs of ``program`` by ``engine`` for values (states, size) of every input port."""
    given = [state.reshape(len(state), *port.shape) for state, port in zip(states, program.inputs, strict=True)]
    return engine.call(program.name, given)


def rounded_up(bound: float) -> str:
    """The number ``bound`` with two digits, never less than it is: "3.9e-13" for 3.81e-13."""
    return f"{float(Context(prec=2, rounding=ROUND_CEILING).create_decimal_from_float(bound)):.1e}"
