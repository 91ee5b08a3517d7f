"""The command ``rrrgen certify``: write the code of a robot together with a certificate of what is known about it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rrrgen.base.parallel import without_collection
from rrrgen.cli.arguments import Number, complete_robot, json_option, only_beside, print_json, read_with_warnings
from rrrgen.cli.generate import chosen_unit, code_options, emit_files, serialized_casadi, with_solver, work_options
from rrrgen.cli.terminal import progress_bar, say, verdict

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit import Real
    from rrrgen.emit.c.language import Trig
    from rrrgen.emit.interface import Rounding


@click.command()
@click.argument("robot", required=False, shell_complete=complete_robot)
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Directory to write.", metavar="DIR")
@click.option(
    "--check",
    "checked",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    metavar="DIR",
    help="Write nothing; say whether code and certificate in DIR belong together, exit with 1 if not.",
)
@click.option("--again", is_flag=True, help="With --check: also compute again what can be computed again.")
@click.option(
    "--speed",
    type=Number(min=0.0, min_open=True),
    metavar="SPEED",
    help="Prove bounds up to this speed of all joints, rad/s (m/s), instead of the limits of the robot file.",
)
@click.option(
    "--acceleration",
    type=Number(min=0.0, min_open=True),
    metavar="ACC",
    help="Likewise for accelerations, rad/s^2 (m/s^2).",
)
@click.option(
    "--value-analysis", is_flag=True, help="Also exclude run-time errors by Frama-C EVA, which takes minutes."
)
@click.option("--samples", type=click.IntRange(min=1), default=200, show_default=True, help="States of the comparison.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of all random states.")
@code_options
@work_options
@json_option
@without_collection()
def certify(
    robot: str | None,
    output: Path | None,
    checked: Path | None,
    again: bool,
    speed: float | None,
    acceleration: float | None,
    value_analysis: bool,
    samples: int,
    seed: int,
    real: Real,
    trig: Trig,
    further: tuple[str, ...],
    casadi_files: bool | None,
    jobs: int,
    method: str | None,
    as_json: bool,
    **experiment: Any,
) -> int:
    """Write the code of a robot with a certificate of what is proven and tested about it.

    DIR receives the files of `rrrgen generate` with the same options, and the folder evidence: certificate.json,
    the same as a page in Markdown and HTML, and test vectors. Proven are bounds of the rounding error of the model
    functions, in double and in float, over the limits of the robot file; tested is every function against independent
    dynamics, as by `rrrgen verify`. What is missing is listed with the reason.

    --check compares the hashes of all files, the pages and the functions with the certificate, and its robot with
    ROBOT if that is given; --again also derives the robot and proves the bounds anew, and compares the templates with
    those of this version.

    \b
    Examples:
      rrrgen certify rrr -o runs/certified
      rrrgen certify --check runs/certified
      rrrgen certify panda -o runs/panda --real float --speed 0.5 --acceleration 1
    """
    if checked is not None:
        only_beside("--check", "robot", "checked", "again", "as_json")
        return _check(checked, robot, again, as_json)
    if again:
        raise click.UsageError("--again belongs to --check")
    if robot is None or output is None:
        raise click.UsageError("give ROBOT and -o DIR, or --check DIR")
    from rrrgen.base.files import write
    from rrrgen.emit.casadi.files import leftover_files
    from rrrgen.evidence.boxes import Ranges
    from rrrgen.evidence.certificate import CERTIFICATE, PAGE, SAMPLED, certificate_files, rounding_entries
    from rrrgen.evidence.coding_rules import checked_with_cppcheck
    from rrrgen.evidence.counts import counts_entry, not_applicable
    from rrrgen.evidence.ik_residual import inverse_kinematics_row
    from rrrgen.evidence.statements import statements
    from rrrgen.evidence.value_analysis import analysed_with_eva
    from rrrgen.runtime import load
    from rrrgen.verify import verify

    casadi = serialized_casadi(casadi_files)
    spec = with_solver(read_with_warnings(robot), method)
    ranges, proven = Ranges(speed, acceleration), dict[str, dict[str, Any]]()

    def bounds(model: DerivedModel) -> Rounding:
        proven.update(rounding_entries(model, trig, ranges, SAMPLED, seed, tell))
        return statements(model.programs, proven, real)

    with progress_bar() as tell:
        model, files = emit_files(spec, real, trig, further, casadi, jobs, experiment, tell, bounds)
    with progress_bar() as tell:
        compiled = load.compile(spec, "c", real)
        words = {*spec.emit, *further}
        report = verify(compiled, samples, seed, tell=tell, hessians="hessian" in words, optional=frozenset(proven))
        forward = proven.get("forward_kinematics", {}).get(real, {}).get("bounds")
        solver, solved = f"{spec.name}_ik.h", inverse_kinematics_row(compiled, forward, seed)
        options = {
            "trig": trig,
            "with": sorted(words),
            "ik": spec.ik,
            "speed": speed,
            "acceleration": acceleration,
        }
        tools, unchecked = checked_with_cppcheck(files, jobs)
        counts, uncounted = counts_entry(spec.name, model.programs, files, real)
        tools, unchecked = tools | counts, [*unchecked, *uncounted]
        if value_analysis:
            unit = chosen_unit(model, experiment) if "controller" in words else None
            differential = bool({"control", "controller"} & words)
            analysis, unanalysed = analysed_with_eva(model, unit, ranges, tell, differential)
            tools, unchecked = tools | analysis, [*unchecked, *unanalysed]
        else:
            unchecked = [*unchecked, ("run-time errors", "--value-analysis was not asked for")]
        tested, untested = _beyond_the_model(files, solver if solved else "")
        files |= certificate_files(
            model,
            files,
            real,
            trig,
            options,
            proven,
            report,
            seed=seed,
            further=tools,
            skipped=[*untested, *unchecked],
            without_bound=[*([(f"rounding of {solver}", *solved)] if solved else []), *tested],
            not_applicable=not_applicable(real),
            tell=tell,
        )
    write(files, output, leftover_files(files, output))
    content = _read(output)
    sampled_within = all(
        stated.get("sampled", {}).get("within", True)
        for entry in content["functions"].values()
        for stated in entry["rounding"].values()
        if isinstance(stated, dict)
    )
    ok = report.ok and sampled_within
    if as_json:
        keys = "digest", "without_bound", "skipped"
        print_json({"directory": str(output), "ok": ok, **{key: content[key] for key in keys}})
        return 0 if ok else 1
    bounded = sum("none" not in entry for entry in proven.values())
    say(f"{spec.name}: rounding bounds of {bounded} of {len(content['functions'])} functions")
    if not sampled_within:
        say("a sampled error exceeds its bound: please report this fault of rrrgen")
    last = report.to_text().splitlines()[-1]
    say(verdict(last, report.ok))
    say(f"{len(content['without_bound'])} without a bound, with the reason and what was found by search")
    say(f"{len(content['skipped'])} items not covered, listed with the reason in {CERTIFICATE}")
    say(f"written to {output}, to be read in {output / PAGE}")
    return 0 if ok else 1


_BEYOND = {
    "_differential_ik.h": "loops: there is no rule for them",
    "_ik.h": "angles have no bound near a singular position",
    "_controller.h": "a tick switches by what it measures and counts; the model functions that it calls have bounds",
    "_any_gravity.h": "a second model, whose bounds are not computed",
}
"""Why there is no rounding bound of the functions of a header, by the end of its name."""


def _beyond_the_model(files: dict[str, Any], solver: str) -> tuple[list[tuple[str, str, str]], list[tuple[str, str]]]:
    """Emitted headers whose functions are no model functions, with the reason why no rounding bound is stated.

    First those of which the emitted self-test has checks, with what it found, then the others. ``solver`` is the header
    of the inverse kinematics for which something stands in the place of a bound, or empty.
    """
    from rrrgen.evidence.self_tests import checks_of, self_test_lines

    headers = sorted(path for path in files if path.endswith(".h") and "/" not in path)
    beyond = [path for path in headers[1:] if not path.endswith("_status.h") and path != solver]
    tested: list[tuple[str, str, str]] = []
    untested: list[tuple[str, str]] = []
    try:
        lines = (self_test_lines(files) if beyond else None) or {}
    except RuntimeError as fault:  # the compiler refuses the code, or a check fails: an open item of each header
        return tested, [(f"rounding of {path}", f"self-test: {fault}") for path in beyond]
    for path in beyond:
        reason = next((why for end, why in _BEYOND.items() if path.endswith(end)), "loops: there is no rule for them")
        sentence = checks_of(path, lines)
        if sentence:
            tested.append((f"rounding of {path}", reason, sentence))
        else:
            untested.append((f"rounding of {path}", reason))
    return tested, untested


def _read(directory: Path) -> dict[str, Any]:
    from rrrgen.evidence.check import read_certificate

    return read_certificate(directory)


def _check(directory: Path, robot: str | None, again: bool, as_json: bool) -> int:
    """Compare the certificate below ``directory`` with the files beside it, and with ``robot`` if that is given.

    ``again`` also derives the robot anew and proves its bounds anew.
    """
    from rrrgen.evidence.check import another_robot, bounds_that_differ, disagreements

    if again and robot is None:
        raise click.UsageError("--again needs ROBOT: rrrgen certify ROBOT --check DIR --again")
    faults = disagreements(directory)
    content = _read(directory)
    if robot is not None and not faults:
        spec = read_with_warnings(robot)
        faults = another_robot(content, spec)
        if again and not faults:
            with progress_bar() as tell:
                faults = bounds_that_differ(content, spec, tell)
    if as_json:
        print_json({"directory": str(directory), "ok": not faults, "disagreements": faults})
    else:
        for fault in faults:
            say(fault)
        last = "code and certificate do not belong together" if faults else "code and certificate belong together"
        say(verdict(f"{content['robot']}: {last}", not faults))
    return 1 if faults else 0
