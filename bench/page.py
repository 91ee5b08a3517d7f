"""The results as a Markdown page."""

from __future__ import annotations

from collections.abc import Sequence

from bench.contenders.contender import HAND, HAND_FILE, OURS, OURS_FILE, OURS_LIBM, PINOCCHIO, TITLES
from bench.measurements.growth import COMPARED
from bench.measurements.race import Score
from bench.results import Results, work
from bench.targets import verdicts

COLUMNS = (OURS, OURS_FILE, OURS_LIBM, HAND, HAND_FILE, PINOCCHIO)


def page(results: Results, plot: str = "benchmark.svg") -> str:
    """The Markdown text of the benchmark page."""
    parts = [_opening(results), f"![Instructions per call]({plot})\n", _targets(results)]
    parts += [_functions(results, robot) for robot in results.robots()]
    parts += [_calls(results), _batches(results), _ik(results), _growth(results), _generation(results)]
    parts += [_mechanisms(results), _hessians(results), _ticks(results), _paths(results)]
    return "\n".join(part for part in parts if part)


def _opening(results: Results) -> str:
    peers = ", ".join(f"{name} {version}" for name, version in results.peers.items())
    lines = [
        "# Benchmark",
        "",
        "Written by `make bench`; the figures below are one run on one machine.",
        "",
        f"- Machine: {results.machine}",
        f"- Compiler and flags, the same for every contender: {results.compiler}",
        f"- Peers: {peers}",
        f"- Effort: {results.effort}",
        "",
        "Every contender is checked against the built-in Newton-Euler on the same states before anything is timed. "
        "Times are the least of many samples, taken in turns; on a shared machine they hold as ratios only. "
        "Instructions are exact: each is single-stepped, mathematical library included. Operations are "
        "multiplications/additions.",
        "",
        f"*{OURS}*: emitted C with base parameters at run time, compared with *{HAND}* and *{PINOCCHIO}* on dense "
        f"bodies. *{OURS_FILE}* and *{HAND_FILE}* use the numbers of the robot file, zeros included. *{OURS_LIBM}*: "
        f"sines of the C library instead of the inline kernel. *{HAND}*: Newton-Euler and composite bodies written by "
        "hand in CasADi, in joint frames and pseudo-inertia base form with all numbers folded, CasADi's common "
        f"subexpressions and C code. *{PINOCCHIO}*: its headers, compiled here.",
    ]
    lines += ["", *(f"- Left out: {text}" for text in results.left_out)]
    return "\n".join(lines) + "\n"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [f"| {' | '.join(head)} |", f"|{'|'.join('---' for _ in head)}|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)]) + "\n"


def _targets(results: Results) -> str:
    found = verdicts(results)
    rows = [(v.work, v.robot, v.target, v.found, "yes" if v.met else "**no**") for v in found]
    met = sum(v.met for v in found)
    text = (
        f"{met} of {len(found)} met. Ratios of functions are instructions, with that of times in brackets; those of "
        "batches, Python calls and inverse kinematics are times.\n\n"
    )
    return "## Targets\n\n" + text + _table(("work", "robot", "target", "found", "met"), rows)


def _functions(results: Results, robot: str) -> str:
    scores = [score for score in results.scores if score.robot == robot]
    present = [label for label in COLUMNS if any(score.contender.label == label for score in scores)]
    rows = []
    for function, title in TITLES.items():
        own = {s.contender.label: s for s in scores if s.contender.function == function}
        if OURS in own:
            rows.append([title, *(_cell(own.get(label)) for label in present), *_ratios(own)])
    head = ["function", *present, f"/ {HAND}", f"/ {PINOCCHIO}"]
    return f"## {robot}\n\nInstructions, ns, operations.\n\n" + _table(head, rows)


def _cell(score: Score | None) -> str:
    if score is None:
        return ""
    count = "-" if score.instructions is None else f"{score.instructions:.0f}"
    operations = score.contender.operations
    tail = f", {operations['mul']}/{operations['add']}" if operations else ""
    return f"{count}, {score.nanoseconds:.1f} ns{tail}"


def _ratios(scores: dict[str, Score]) -> list[str]:
    return [f"{work(scores[OURS]) / work(scores[rival]):.2f}" if rival in scores else "" for rival in (HAND, PINOCCHIO)]


def _calls(results: Results) -> str:
    if not results.calls:
        return ""
    robots = list(dict.fromkeys(call.robot for call in results.calls))
    interfaces = list(dict.fromkeys(call.interface for call in results.calls))
    rows = []
    for interface in interfaces:
        times = (results.call(robot, interface) for robot in robots)
        rows.append([interface, *("" if time is None else f"{time:.0f}" for time in times)])
    return "## Python calls of inverse dynamics (ns)\n\n" + _table(["interface", *robots], rows)


def _batches(results: Results) -> str:
    rows = []
    for robot, times in results.batches.items():
        ratio = results.batch_ratio(robot)
        rows.append([robot, f"{times.batch:.1f}", f"{times.single:.1f}", "" if ratio is None else f"1/{1 / ratio:.0f}"])
    if not rows:
        return ""
    head = ["robot", "ns per state, from NumPy", "ns of one C call", "against Pinocchio's call"]
    return "## Batches of inverse dynamics, one core\n\n" + _table(head, rows)


def _ik(results: Results) -> str:
    if not results.ik:
        return ""
    rows = []
    for score in results.ik:
        count = "" if score.instructions is None else f"{score.instructions:.0f}"
        rows.append([score.robot, score.solver, f"{score.nanoseconds:.0f}", count, f"{score.rows:.1f}"])
    text = "All solutions of reachable poses, every row checked. EAIK: its Python batch interface, one thread. "
    text += "C by hand: the textbook's closed form with the C library's arc tangent, without any check.\n\n"
    return "## Inverse kinematics\n\n" + text + _table(["robot", "solver", "ns", "instructions", "rows per pose"], rows)


def _growth(results: Results) -> str:
    if not results.growth:
        return ""
    chains = list(dict.fromkeys(score.robot for score in results.growth))
    rows = []
    for chain, seconds in zip(chains, results.derivations, strict=True):
        found = {(s.contender.function, s.contender.label): s for s in results.growth if s.robot == chain}
        row = [chain.removeprefix("chain"), f"{seconds:.1f}"]
        for function in COMPARED:
            scores = {label: found[function, label] for label in (OURS, HAND, PINOCCHIO) if (function, label) in found}
            row += [_cell(scores.get(OURS)), *_ratios(scores)]
        rows.append(row)
    head = ["n", "derivation s"]
    for function in COMPARED:
        head += [TITLES[function], f"/ {HAND}", f"/ {PINOCCHIO}"]
    text = "Random chains of revolute joints, neighbouring axes parallel or at right angles, dense bodies.\n\n"
    return "## Growth with the number of joints\n\n" + text + _table(head, rows)


def _generation(results: Results) -> str:
    rows = [
        [
            each.robot,
            f"{each.generate:.1f}",
            f"{each.compile:.1f}",
            "" if each.megabytes is None else f"{each.megabytes:.0f}",
        ]
        for each in results.generations
    ]
    if not rows:
        return ""
    text = "Elapsed seconds of the fastest run; the C compiler takes `-O2` and all sources side by side.\n\n"
    head = ["robot", "generate", "compile", "peak MB"]
    return "## From robot file to compiled C\n\n" + text + _table(head, rows)


def _mechanisms(results: Results) -> str:
    rows = [
        [
            each.robot,
            each.function.replace("_", " "),
            str(each.operations),
            f"{each.nanoseconds:.0f}",
            f"{each.pinocchio:.0f}",
            f"{each.nanoseconds / each.pinocchio:.2f}",
        ]
        for each in results.mechanisms
    ]
    if not rows:
        return ""
    text = (
        "Trees (hand, torso), a floating base (quadruped), and closed loops (the palletiser without its wrist), with "
        "the numbers of the robot file folded, by `python -m bench --only mechanisms`. Pinocchio: `rnea`, `crba`, "
        "`aba`. It has no inverse dynamics of a closed loop: it is given positions of the passive joints that close "
        "it, and carries rates and torques over to the drives by its Jacobians, while rrrgen solves the loop as well. "
        "Results agree to 1e-10 of their size.\n\n"
    )
    head = ["robot", "function", "operations", "rrrgen, ns", "Pinocchio, ns", "/ Pinocchio"]
    return "## Trees, floating bases and closed loops\n\n" + text + _table(head, rows)


def _hessians(results: Results) -> str:
    rows = [
        [
            each.robot,
            each.function.replace("_", " "),
            str(each.operations),
            f"{each.nanoseconds:.0f}",
            *("" if time is None else f"{time:.0f}" for time in (each.casadi, each.pinocchio)),
            *("" if time is None else f"{each.nanoseconds / time:.2f}" for time in (each.casadi, each.pinocchio)),
        ]
        for each in results.hessians
    ]
    if not rows:
        return ""
    text = (
        "With the numbers of the robot file folded, by `python -m bench --only hessians`. CasADi: the Hessian of "
        "`weights' tau`, and its product with a direction, that it derives from a Newton-Euler recursion written by "
        "hand, common subexpressions shared. Pinocchio: `ComputeRNEASecondOrderDerivatives`, all second derivatives "
        "at once. Results agree to 1e-11 of the largest.\n\n"
    )
    head = ["robot", "function", "operations", "rrrgen, ns", "CasADi, ns", "Pinocchio, ns", "/ CasADi", "/ Pinocchio"]
    return "## Second derivatives\n\n" + text + _table(head, rows)


def _ticks(results: Results) -> str:
    rows = [[each.robot, str(each.parameters), each.work, f"{each.nanoseconds:.0f}"] for each in results.ticks]
    if not rows:
        return ""
    text = (
        "Kalman filter, neural friction and an online estimator of all base parameters; and a whole loop with computed "
        "torque, friction at the desired speed, limits and the momentum observer. Each sample of a motion.\n\n"
    )
    return "## One tick of the controller\n\n" + text + _table(["robot", "parameters", "work", "ns"], rows)


def _paths(results: Results) -> str:
    rows = [
        [each.robot, str(each.joints), each.friction, f"{each.duration:.3f}", f"{each.microseconds:.0f}"]
        for each in results.paths
    ]
    if not rows:
        return ""
    text = "Time-optimal timing of a path of 1000 points under limits of torque, speed and acceleration.\n\n"
    head = ["robot", "joints", "friction", "duration, s", "microseconds"]
    return "## Timing of a path\n\n" + text + _table(head, rows)
