"""The certificate of emitted code, ``rrrgen-certificate/1``: what is proven, tested and not covered, as plain data.

It holds no time, host or path: the same robot, options and tools give the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.cache import digest
from rrrgen.base.errors import is_installed
from rrrgen.base.files import Contents, checksum
from rrrgen.base.templates import templates_digest
from rrrgen.derive.functions.table import find
from rrrgen.emit.c.language import ERROR_BOUND, RANGE, Trig
from rrrgen.emit.c.stack import stack_bound
from rrrgen.evidence.boxes import PortRange, Ranges, box_of, nominal_beta
from rrrgen.evidence.kernel_proof import scripts
from rrrgen.evidence.rounding import DOUBLE, FLOAT, LIBRARY_UNITS, NoBoundError, Precision, rounding_bounds
from rrrgen.evidence.sampling import RESOLUTION, has_wide_format, largest_errors, relative_errors
from rrrgen.evidence.solutions import Solution, solution_of
from rrrgen.evidence.vectors import test_vectors
from rrrgen.program import count_operations
from rrrgen.robot.identity import identify

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rrrgen.base.parallel import Tell
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit import Real
    from rrrgen.program import Program
    from rrrgen.robot.spec import RobotSpec
    from rrrgen.verify.report import Report

SCHEMA = "rrrgen-certificate/1"
FOLDER = "evidence"
CERTIFICATE = f"{FOLDER}/certificate.json"
MARKDOWN = f"{FOLDER}/certificate.md"
PAGE = f"{FOLDER}/certificate.html"
VECTORS = f"{FOLDER}/vectors.json"

METHOD = "mean-value form over the roundings in reverse and forward mode, outward rounding, angles in equal parts"
RESIDUAL_METHOD = f"backward analysis of M = L D L'; its sums: {METHOD}"

CONDITION = "every comparison of the function comes out as in exact arithmetic"
"""What the bounds of the outputs under ``conditional`` suppose: next to a switch, rounding may take its other side."""

LIBRARY = f"tanh and exp of the C library are within {LIBRARY_UNITS} units in the last place"
"""What bounds suppose of the C library, where it is called."""

NOT_CLAIMED = (
    "a safety level, or the qualification of a tool",
    "a worst-case execution time",
    "that the robot file describes the arm",
    "that compiler, C library and processor are correct; bounds hold for IEEE arithmetic, rounding to nearest",
    "bounds or the absence of run-time errors outside the stated boxes, or with -ffast-math",
    "that sampled figures are largest ones: only what is called a bound is proven",
)
"""What the certificate does not say, for its reader."""

VECTORS_PER_FUNCTION = 4
SAMPLED = 2000
"""Random states per function and precision at which the errors beside the bounds are sampled."""

_EQUATION = re.compile(r"\(14\.\d+\)")


def rounding_entries(
    model: DerivedModel, trig: Trig, ranges: Ranges, samples: int = 0, seed: int = 0, tell: Tell | None = None
) -> dict[str, dict[str, Any]]:
    """The entry ``rounding`` of every function of ``model``, by name; see :func:`rounding_entry`.

    ``trig`` is the source of sines and cosines, of which only the emitted kernel has a bound; ``ranges`` are those of
    the inputs over which bounds are proven. ``tell(done, total, message)`` is called as the work proceeds.
    """
    roundings = {}
    for done, (name, program) in enumerate(model.programs.items()):
        if tell is not None:
            tell(done, len(model.programs), f"rounding of {name}")
        if trig == "libm" and count_operations(program).sincos:
            roundings[name] = {"none": "sines and cosines of the C library, which states no error bound"}
            continue
        box = box_of(program, model.spec, nominal_beta(model), ranges)
        solution = solution_of(model.programs, name)
        entries = [partial(rounding_entry, program, box, samples, seed)]
        if solution is not None:
            residuals = partial(residual_entry, solution, model.spec, box, ranges, samples, seed)
            entries.insert(0 if solution.residual_first else 1, residuals)
        for entry in entries:
            roundings[name] = entry()
            if "none" not in roundings[name]:
                break
        else:
            roundings[name] |= errors_without_bound(program, box, samples, seed)
    return roundings


def rounding_entry(program: Program, box: Mapping[str, PortRange], samples: int, seed: int) -> dict[str, Any]:
    """The entry ``rounding`` of a function: bounds and box in both precisions, or the reason why there is no bound.

    With ``samples``, the errors found at so many random states and by a search from the worst of them stand beside.
    """
    try:
        bounds = rounding_bounds(program, {name: port_range.bounds for name, port_range in box.items()})
    except NoBoundError as reason:
        return {"none": str(reason)}
    values = {
        precision: {port.name: list(row) for port, row in zip(program.outputs, rows, strict=True)}
        for precision, rows in ((DOUBLE, bounds.double), (FLOAT, bounds.single))
    }
    entry: dict[str, Any] = {"parts_per_angle": bounds.parts, "method": METHOD}
    if any(bounds.conditional):
        names = [
            port.name for port, conditional in zip(program.outputs, bounds.conditional, strict=True) if conditional
        ]
        entry["conditional"] = {"outputs": names, "condition": CONDITION}
    if bounds.library:
        entry["assumption"] = LIBRARY
    sampled = partial(largest_errors, program, box, conditional=bounds.conditional)
    return entry | _precision_entries(values, box, samples, seed, sampled)


def residual_entry(
    solution: Solution, spec: RobotSpec, box: Mapping[str, PortRange], ranges: Ranges, samples: int, seed: int
) -> dict[str, Any]:
    """The entry ``rounding`` of a function that solves with M: bounds of residuals, or the reason why there are none.

    ``box`` has the ranges of its inputs.
    """
    try:
        box = solution.box(box, spec, ranges)
        residuals = solution.bounds(box)
    except NoBoundError as reason:
        return {"none": str(reason)}
    entry: dict[str, Any] = {
        "quantity": solution.quantity,
        "parts_per_angle": residuals.parts,
        "method": RESIDUAL_METHOD,
    }
    stated = _precision_entries(residuals.bounds, box, samples, seed, partial(solution.largest, box))
    for precision, least in residuals.least.items():
        if least > 0.0:
            stated[precision.name]["least_diagonal_of_M"] = least
    return entry | stated


def errors_without_bound(program: Program, box: Mapping[str, PortRange], samples: int, seed: int) -> dict[str, Any]:
    """What stands in the place of a bound that cannot be proven: the relative errors at random states, by precision.

    Nothing without ``samples``, or where an input has no range.
    """
    if not samples or any(port.name not in box for port in program.inputs):
        return {}
    entries = {}
    for precision in filter(has_wide_format, (DOUBLE, FLOAT)):
        errors = relative_errors(program, box, precision, samples, seed)
        entries[precision.name] = {
            "box": {name: _range(port_range) for name, port_range in box.items()},
            "sampled": {
                "states": samples,
                "seed": seed,
                "median_relative": _short(float(np.median(errors))),
                "largest_relative": _short(float(np.max(errors))),
            },
        }
    return entries


def _precision_entries(
    bounds: Mapping[Precision, Mapping[str, list[float]]],
    box: Mapping[str, PortRange],
    samples: int,
    seed: int,
    sampled: Callable[[Precision, int, int], NDArray[np.float64]],
) -> dict[str, Any]:
    """Bounds, box and the largest errors that are found, by the name of the precision."""
    entry: dict[str, Any] = {}
    for precision, rows in bounds.items():
        flat = [value for row in rows.values() for value in row]
        stated: dict[str, Any] = {
            "box": {name: _range(port_range) for name, port_range in box.items()},
            "bounds": dict(rows),
            "worst": max(flat, default=0.0),
        }
        if samples and has_wide_format(precision):
            errors = sampled(precision, samples, seed)
            worst = float(errors.max(initial=0.0))
            stated["sampled"] = {
                "states": samples,
                "seed": seed,
                "largest": _short(worst),
                "ratio": _short(stated["worst"] / worst) if worst > 0.0 else None,
                "within": bool(all(e <= RESOLUTION * b for e, b in zip(errors.tolist(), flat, strict=True))),
            }
        entry[precision.name] = stated
    return entry


def _short(value: float) -> float:
    return float(f"{value:.3g}")


def _range(port: PortRange) -> dict[str, Any]:
    return {"lower": list(port.lower), "upper": list(port.upper), "source": port.source}


def certificate_files(
    model: DerivedModel,
    files: Mapping[str, Contents],
    real: Real,
    trig: Trig,
    options: Mapping[str, Any],
    rounding: Mapping[str, Mapping[str, Any]],
    verification: Report | None,
    seed: int = 0,
    further: Mapping[str, Any] | None = None,
    skipped: Sequence[tuple[str, str]] = (),
    not_applicable: Sequence[tuple[str, str]] = (),
    without_bound: Sequence[tuple[str, str, str]] = (),
    tell: Tell | None = None,
) -> dict[str, Contents]:
    """The files of the folder ``evidence`` for the emitted ``files`` of ``model``: relative path -> contents.

    Args:
        model: the derived robot that was emitted.
        files: all emitted files.
        real: the floating-point type of the C code.
        trig: the source of sines and cosines; bounds exist for the emitted kernel only.
        options: the options of the command, as the certificate states them.
        rounding: the entry about rounding errors of every function, from :func:`rounding_entries`.
        verification: the report of ``rrrgen verify`` for this model, or None where it was not made.
        seed: of the test vectors.
        further: entries of the certificate about external tools, by name.
        skipped: what was not done, with the reason.
        not_applicable: what cannot be done for this code, with the reason.
        without_bound: what has no bound of its errors, with the reason and with what was found in its place.
        tell: called as ``tell(done, total, message)`` as the work proceeds.
    """
    from rrrgen.evidence.page import html, markdown

    spec, identity = model.spec, identify(model.spec)
    missing, instead = list(skipped), list(without_bound)
    functions: dict[str, Any] = {}
    vectors: dict[str, Any] = {}
    for done, (name, program) in enumerate(model.programs.items()):
        if tell is not None:
            tell(done, len(model.programs), f"test vectors of {name}")
        proven = rounding[name]
        if "none" in proven and real in proven:
            instead.append((f"rounding of {name}", proven["none"], _relative(proven[real]["sampled"])))
        elif "none" in proven:
            missing.append((f"rounding of {name}", proven["none"]))
        elif "quantity" not in proven:  # exact outputs with their bounds; a residual is no error of an output
            stated = proven[real]
            box = {port: PortRange(**limits) for port, limits in stated["box"].items()}
            vectors[name] = {
                "bounds": stated["bounds"],
                "states": test_vectors(program, box, real == "float", VECTORS_PER_FUNCTION, seed),
            }
        functions[name] = {
            "equations": _equations(name),
            "checks": _checks(name, verification),
            "rounding": proven,
            "operations": count_operations(program).as_dict(),
            "stack_bound": asdict(stack_bound(program, real)),
        }
    if verification is None:
        missing.append(("verification", "not asked for"))
    else:
        missing += [(f"verification: {name}", reason) for name, reason in verification.skipped]
        missing += [
            (f"verification of {name}", "no check of this name")
            for name, entry in functions.items()
            if not entry["checks"]
        ]
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "robot": spec.name,
        "model_hash": identity.model_hash,
        "tool": f"rrrgen {identity.tool_version}",
        "real": real,
        "options": dict(options),
        "files": {path: checksum(files[path]) for path in sorted(files)},
        "templates": templates_digest(),
        "tools": tool_versions(),
        "kernel": {
            "double": _kernel("double"),
            "float": _kernel("float"),
        },
        "functions": functions,
        "verification": None if verification is None else verification.to_dict(),
        **dict(further or {}),
        "trace": _trace(functions),
        "without_bound": [
            {"what": what, "reason": reason, "instead": substitute} for what, reason, substitute in instead
        ],
        "skipped": [{"what": what, "reason": reason} for what, reason in missing],
        "not_applicable": [{"what": what, "reason": reason} for what, reason in not_applicable],
        "not_claimed": list(NOT_CLAIMED),
    }
    vector_text = json_text({"schema": "rrrgen-vectors/1", "robot": spec.name, "real": real, "functions": vectors})
    content["evidence"] = {VECTORS: checksum(vector_text)}
    content["digest"] = content_digest(content)
    return {
        CERTIFICATE: json_text(content),
        MARKDOWN: markdown(content),
        PAGE: html(content),
        VECTORS: vector_text,
    }


def _relative(sampled: Mapping[str, Any]) -> str:
    return (
        f"relative error of an output at {sampled['states']} random states: median {sampled['median_relative']:.2g}, "
        f"largest {sampled['largest_relative']:.2g}"
    )


def _kernel(real: Real) -> dict[str, Any]:
    """The entry of the kernel of sine and cosine, with the digest of the scripts that prove its bound."""
    return {
        "absolute_error": ERROR_BOUND[real],
        "range_rad": float(RANGE[real]),
        "proof": "Gappa, Sollya and the mean-value form: rrrgen/evidence/kernel_proof.py",
        "scripts": digest(*(part for item in sorted(scripts(real).items()) for part in item)),
    }


def content_digest(content: Mapping[str, Any]) -> str:
    """SHA-256 of the certificate's content without the digest itself; it finds accidents, not forgery."""
    rest = {key: value for key, value in content.items() if key != "digest"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def json_text(content: Mapping[str, Any]) -> str:
    """The text of a file of the folder: numbers as short as they can be, lines end with a line feed."""
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def tool_versions() -> dict[str, str]:
    """Versions of the Python packages that take part, by name."""
    from importlib.metadata import version

    return {name: version(name) for name in ("numpy", "sympy", "mpmath", "casadi") if is_installed(name)}


def _base(name: str) -> str:
    return name.removesuffix("_nominal")


def _equations(name: str) -> list[str]:
    function = find(_base(name))
    return [] if function is None else sorted(set(_EQUATION.findall(f"{function.summary} {function.details}")))


def _checks(name: str, report: Report | None) -> list[str]:
    """The comparisons of the verification that name the function: reference, what was compared."""
    if report is None:
        return []
    word = re.compile(rf"(^|[^\w]){re.escape(_base(name))}($|[^\w])")
    aliases = _ALIASES.get(_base(name), ())
    return list(
        dict.fromkeys(
            f"{row.function} against {row.reference}"
            for row in report.rows
            if word.search(row.function) or row.function in aliases
        )
    )


_ALIASES = {"regressor": ("regressor K", "tau = Y beta + Ia ddq"), "regressor_transpose": ("regressor_transpose K",)}
"""Checks of functions whose rows are not named after them."""


def _trace(functions: Mapping[str, Any]) -> list[dict[str, Any]]:
    rows = [
        {"equation": equation, "function": name, "checks": entry["checks"]}
        for name, entry in functions.items()
        for equation in entry["equations"]
    ]
    return sorted(rows, key=lambda row: (float(row["equation"].strip("()")[3:]), row["function"]))
