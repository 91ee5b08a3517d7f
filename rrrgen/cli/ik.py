"""The command ``rrrgen ik``: solve the inverse kinematics in closed form."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from rrrgen.base.tables import text_table
from rrrgen.cli.arguments import Number, ik_option, json_option, print_json, read_with_warnings, robot_argument
from rrrgen.cli.terminal import doubtful, say, terminal_width, working

if TYPE_CHECKING:
    from rrrgen.ik.inverse_kinematics import InverseKinematics
    from rrrgen.ik.results import IKResult
    from rrrgen.robot.spec import RobotSpec
    from rrrgen.runtime.engines import EngineName


@click.command()
@robot_argument
@click.option(
    "--pose",
    required=True,
    help="Position 'x y z' (m), position and fixed-axis angles 'x y z roll pitch yaw' (rad), or 16 numbers, row-major.",
)
@click.option(
    "--near",
    metavar="Q",
    help="Reference configuration 'q1 q2 ...', rad or m: determines free angles, full turns and the order.",
)
@click.option(
    "--limits/--no-limits", default=True, show_default=True, help="Leave out solutions outside the joint limits."
)
@click.option(
    "--tip", metavar="NAME", help="Named tip of a branching robot; --near then holds the joints that tips share."
)
@click.option(
    "--redundancy", type=Number(), help="Prescribed joint variable or arm angle of a redundant arm, rad or m."
)
@click.option(
    "--closest", is_flag=True, help="Also for unreachable poses: the configuration with the least-squares error."
)
@click.option(
    "--backend",
    type=click.Choice(["c", "numpy"]),
    default="c",
    show_default=True,
    help="Compiled C, or the recorded equations in Python, which need no compiler.",
)
@ik_option
@json_option
def ik(
    robot: str,
    pose: str,
    near: str | None,
    tip: str | None,
    backend: EngineName,
    method: str | None,
    as_json: bool,
    **options: Any,
) -> int:
    """Solve the inverse kinematics in closed form: all configurations that reach a pose.

    Prints the family of the arm and one line per solution with its branch. If there is none, prints the reason and the
    distance to the workspace, and exits with 1. Of a named tip the joints are solved that move it and no tip beside it.

    \b
    Examples:
      rrrgen ik rrr --pose '0.2 -0.4 0.6'
      rrrgen ik puma560 --pose '0.4 0.1 0.3 0 3.1416 0' --near '0 0 0 0 0 0' --json
      rrrgen ik hand.yaml --tip thumb --pose '0 -1 0 .12 -1 0 0 -.06 0 0 -1 .195 0 0 0 1' --near '0 0 0 0 0 0 0 0'
    """
    from rrrgen.runtime.inverse_kinematics import load_solver

    spec = read_with_warnings(robot)
    spec = spec if method is None else replace(spec, ik=method)
    target = _target(pose)
    reference = None if near is None else _numbers(near, "--near", (spec.n,))
    if tip is not None:
        spec, target, reference = _of_tip(spec, tip, target, reference)
    with working("compiling the solver"):
        solver = load_solver(spec, backend=backend)
    chosen = {"limits": options["limits"], "redundancy": options["redundancy"]}
    if options["closest"]:
        solutions = solver.closest(target, reference, **chosen)
    else:
        solutions = solver.solve(target, reference, sort="branch" if reference is None else "nearest", **chosen)
    if as_json:
        print_json(_record(spec, solver, solutions))
    else:
        _print(spec, solver, solutions)
    return 0 if len(solutions) else 1


def _of_tip(
    spec: RobotSpec, tip: str, target: Any, reference: list[float] | None
) -> tuple[RobotSpec, Any, list[float] | None]:
    """The robot of the own joints of a named tip, with the target in its base frame and the reference of its joints."""
    import numpy as np

    from rrrgen.derive import prepare, record
    from rrrgen.derive.functions.table import get_function
    from rrrgen.program import evaluate
    from rrrgen.robot.model.mechanism import tip_arm

    if tip not in spec.tips:
        known = ", ".join(spec.tips) or "none: name them under tips in the robot file"
        raise click.BadParameter(f"the robot has no tip '{tip}'; its tips are {known}", param_hint="--tip")
    arm = tip_arm(spec, tip)
    tip_reference = None if reference is None else [reference[k] for k in arm.joints]
    if not arm.shared:
        return arm.spec, target, tip_reference
    if reference is None:
        names = ", ".join(spec.joints[k].name for k in arm.shared)
        raise click.UsageError(f"--tip {tip} needs --near, which holds {names}, shared with other tips")
    pose = np.eye(4)
    pose[:3, 3] = target[:3, 3] if target.ndim == 2 else target
    pose[:3, :3] = target[:3, :3] if target.ndim == 2 else pose[:3, :3]
    name = f"{tip}_tip_target"
    program = record(prepare(spec), (get_function(name),)).alternatives[name][0]
    (seen,) = evaluate(program, pose, np.array(reference))
    return arm.spec, seen if target.ndim == 2 else seen[:3, 3], tip_reference


def _numbers(text: str, option: str, sizes: tuple[int, ...]) -> list[float]:
    try:
        numbers = [float(part) for part in text.replace(",", " ").split()]
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint=option) from None
    if len(numbers) not in sizes:
        raise click.BadParameter(f"{len(numbers)} numbers; wanted {' or '.join(map(str, sizes))}", param_hint=option)
    return numbers


def _target(text: str) -> Any:
    """The target of the option ``--pose``: a position (3,), or a pose (4, 4)."""
    import numpy as np

    numbers = _numbers(text, "--pose", (3, 6, 16))
    if len(numbers) == 3:
        return np.array(numbers)
    if len(numbers) == 16:
        return np.array(numbers).reshape(4, 4)
    (cr, cp, cy), (sr, sp, sy) = np.cos(numbers[3:]), np.sin(numbers[3:])
    T = np.eye(4)
    T[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    T[:3, 3] = numbers[:3]
    return T


def _record(spec: RobotSpec, solver: InverseKinematics, solutions: IKResult) -> dict[str, Any]:
    return {
        "joints": [{"name": joint.name, "unit": "rad" if joint.is_revolute else "m"} for joint in spec.joints],
        "family": str(solver.plan.family),
        "max_solutions": solver.max_solutions,
        "incomplete": solver.plan.incomplete or None,
        "approach": solver.plan.approach or None,
        "status": solutions.status,
        "reason": solutions.reason,
        "distance": solutions.distance,
        "solutions": [
            {"q": q.tolist(), "branch": solver.branch_names(branch), "flags": int(flags), "residual": float(residual)}
            for q, branch, flags, residual in zip(
                solutions.q, solutions.branch, solutions.flags, solutions.residual, strict=True
            )
        ],
    }


def _headings(spec: RobotSpec) -> tuple[str, ...]:
    """The headings of the table: number of the solution, joints with their units, the other columns."""
    units = (f"{joint.name} [{'rad' if joint.is_revolute else 'm'}]" for joint in spec.joints)
    return ("#", *units, "branch", "remarks")


def _print(spec: RobotSpec, solver: InverseKinematics, solutions: IKResult) -> None:
    from rrrgen.runtime.results import FREE, INEXACT, MULTIPLE, OUTSIDE

    words = {MULTIPLE: "multiple", FREE: "free angle from the reference", OUTSIDE: "outside limits", INEXACT: "inexact"}
    say(f"{solver.plan.family}: at most {solver.max_solutions} solutions")
    rows = [_headings(spec)]
    for number, (q, branch, flags) in enumerate(zip(solutions.q, solutions.branch, solutions.flags, strict=True), 1):
        names = " ".join(f"{name}={value}" for name, value in solver.branch_names(branch).items())
        remarks = ", ".join(text for bit, text in words.items() if flags & bit)
        rows.append((str(number), *(f"{value:.6f}" for value in q), names, remarks))
    if len(solutions):
        say("\n".join(text_table(rows, terminal_width(), right=range(1, spec.n + 1))))
    if not len(solutions):
        distance = f", {solutions.distance:.6g} m from reach" if solutions.distance > 0 else ""
        say(
            f"{doubtful('no solution')}: {solutions.status}"
            f"{': ' + solutions.reason if solutions.reason else ''}{distance}"
        )
    if solver.plan.approach:
        say(solver.plan.approach)
    if solver.plan.incomplete:
        say(f"there may be more: {solver.plan.incomplete}")
    elif solutions.status == "incomplete" and len(solutions):
        say(solutions.reason)
