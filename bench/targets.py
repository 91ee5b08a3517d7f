"""The performance targets of rrrgen, and whether a run met them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from bench.contenders.contender import HAND, OURS, OURS_FILE, PINOCCHIO, TITLES
from bench.measurements.control_loop import WORK
from bench.measurements.python_calls import BOUND_RUN, PIN
from bench.results import Results, work

OPERATIONS = {
    ("rrr", "inverse_dynamics"): (55, 45),
    ("puma560", "inverse_dynamics"): (215, 195),
    ("ur10e", "inverse_dynamics"): (200, 180),
    ("panda", "inverse_dynamics"): (312, 288),
    ("rrr", "mass_matrix"): (38, 36),
    ("puma560", "mass_matrix"): (153, 149),
    ("panda", "mass_matrix"): (213, 191),
    ("rrr", "regressor"): (92, 67),
    ("puma560", "regressor"): (383, 277),
    ("panda", "regressor"): (684, 473),
    ("rrr", "gravity"): (10, 5),
    ("puma560", "gravity"): (50, 28),
    ("panda", "gravity"): (64, 38),
}
"""Multiplications and additions with base parameters at run time. For the Puma and the UR these are the aims; the
rival that had to be beaten takes 254/233."""

CORIOLIS_FLOPS = {"puma560": 1500}
RATIOS = {"rrr": (0.45, 0.10), "puma560": (0.85, 0.25), "ur10e": (0.85, 0.25), "panda": (0.85, 0.25)}
"""Instructions of inverse dynamics: against the hand-made rival, against Pinocchio."""

NOT_SLOWER = ("mass_matrix", "bias", "gravity", "forward_dynamics", "kinematics", "regressor")
BATCH = {"rrr": 1 / 40, "panda": 1 / 25}
REFERENCE = ("rrr", 313.0)
"""Nanoseconds of Pinocchio's inverse dynamics of this robot on the machine for which the next targets were set."""

INVERSE_KINEMATICS = {"rrr": 100.0, "puma560": 400.0, "ur10e": 1000.0, "general6r": 50000.0}
"""Nanoseconds for all solutions on that machine; another one is compared by its time for the reference."""

IK_RATIOS = {"rrr": ("C by hand", 1.0), "puma560": ("EAIK", 0.15), "ur10e": ("EAIK", 0.20)}
"""Times against a rival of the same run, which noise leaves alone."""

TICK = {"rrr": 2000.0}
"""Nanoseconds of one tick with Kalman filter, friction and recursive least squares."""

LOOP = {"panda": 700.0}
"""Nanoseconds of one tick of a whole loop of seven joints."""

SECONDS = {"rrr": 3.0, "panda": 20.0}
MEGABYTES = 500.0


@dataclass(frozen=True)
class Verdict:
    """One target: what is compared, the limit, and the measured value."""

    work: str
    robot: str
    target: str
    found: str
    met: bool


def verdicts(results: Results) -> list[Verdict]:
    """Every target that the run has figures for."""
    ik = (_inverse_kinematics, _inverse_kinematics_rivals)
    parts = (_operations, _ratios, _transpose, _not_slower, _batches, *ik, _calls, _generation, _ticks)
    return [verdict for part in parts for verdict in part(results)]


def _operations(results: Results) -> Iterator[Verdict]:
    for (robot, function), (mul, add) in OPERATIONS.items():
        score = results.score(robot, function, OURS)
        if score is not None and score.contender.operations:
            got = score.contender.operations
            met = got["mul"] <= mul and got["add"] <= add
            what = f"{TITLES[function]}, operations"
            yield Verdict(what, robot, f"<= {mul}/{add}", f"{got['mul']}/{got['add']}", met)
    for robot, flops in CORIOLIS_FLOPS.items():
        score = results.score(robot, "coriolis_matrix", OURS)
        if score is not None and score.contender.operations:
            total = score.contender.operations["mul"] + score.contender.operations["add"]
            yield Verdict("Coriolis matrix, operations", robot, f"< {flops}", str(total), total < flops)


def _ratio(results: Results, what: str, robot: str, function: str, rival: str, limit: float) -> Iterator[Verdict]:
    own, other = results.score(robot, function, OURS), results.score(robot, function, rival)
    if own is not None and other is not None:
        value, times = work(own) / work(other), own.nanoseconds / other.nanoseconds
        yield Verdict(what, robot, f"<= {limit:.2f} x", f"{value:.2f} x (time {times:.2f} x)", value <= limit)


def _ratios(results: Results) -> Iterator[Verdict]:
    for robot, (hand, pinocchio) in RATIOS.items():
        for rival, limit in ((HAND, hand), (PINOCCHIO, pinocchio)):
            what = f"inverse dynamics against {rival}"
            yield from _ratio(results, what, robot, "inverse_dynamics", rival, limit)


def _transpose(results: Results) -> Iterator[Verdict]:
    for robot in results.robots():
        own = results.score(robot, "regressor_transpose", OURS)
        regressor, inverse = (results.score(robot, name, OURS) for name in ("regressor", "inverse_dynamics"))
        if own is not None and regressor is not None and inverse is not None:
            to_regressor, to_inverse = work(own) / work(regressor), work(own) / work(inverse)
            yield Verdict("Y' e against forming Y", robot, "< 1.00 x", f"{to_regressor:.2f} x", to_regressor < 1)
            yield Verdict("Y' e against inverse dynamics", robot, "<= 2.00 x", f"{to_inverse:.2f} x", to_inverse <= 2)


def _not_slower(results: Results) -> Iterator[Verdict]:
    for robot in results.robots():
        for function in NOT_SLOWER:
            limit = 0.75 if robot == "rrr" else 1.0
            yield from _ratio(results, f"{TITLES[function]} against {HAND}", robot, function, HAND, limit)


def _batches(results: Results) -> Iterator[Verdict]:
    for robot, limit in BATCH.items():
        ratio = results.batch_ratio(robot)
        if ratio is not None:
            text = f"1/{1 / ratio:.0f} ({results.batches[robot].batch:.1f} ns per state)"
            yield Verdict(
                "batch inverse dynamics per state against Pinocchio",
                robot,
                f"<= 1/{1 / limit:.0f}",
                text,
                ratio <= limit,
            )


def _inverse_kinematics(results: Results) -> Iterator[Verdict]:
    robot, nanoseconds = REFERENCE
    pinocchio, own = (results.score(robot, "inverse_dynamics", label) for label in (PINOCCHIO, OURS_FILE))
    if pinocchio is None or own is None:
        return
    for score in results.ik:
        limit = INVERSE_KINEMATICS.get(score.robot)
        if score.solver == OURS and limit is not None and score.reference is not None:
            # noise changes between races, so both ratios are of times taken in turns
            ratio = score.nanoseconds / score.reference * own.nanoseconds / pinocchio.nanoseconds
            found = f"{ratio:.2f} x ({score.nanoseconds:.0f} ns, {score.rows:.1f} rows)"
            met = ratio <= limit / nanoseconds
            what = "inverse kinematics against Pinocchio's inverse dynamics of the RRR"
            yield Verdict(what, score.robot, f"<= {limit / nanoseconds:.2f} x", found, met)


def _inverse_kinematics_rivals(results: Results) -> Iterator[Verdict]:
    times = {(score.robot, score.solver): score.nanoseconds for score in results.ik}
    for robot, (rival, limit) in IK_RATIOS.items():
        if (robot, OURS) in times and (robot, rival) in times:
            ratio = times[robot, OURS] / times[robot, rival]
            what = f"inverse kinematics against {rival}"
            yield Verdict(what, robot, f"<= {limit:.2f} x", f"{ratio:.2f} x", ratio <= limit)


def _calls(results: Results) -> Iterator[Verdict]:
    for robot in results.robots():
        bound, pin = results.call(robot, BOUND_RUN), results.call(robot, PIN)
        if bound is not None and pin is not None:
            found = f"{bound / pin:.2f} x ({bound:.0f} against {pin:.0f} ns)"
            yield Verdict("Python call, bound buffers, against pin.rnea", robot, "<= 0.33 x", found, bound <= pin / 3)


def _generation(results: Results) -> Iterator[Verdict]:
    for each in results.generations:
        limit = SECONDS.get(each.robot)
        if limit is not None:
            total = each.generate + each.compile
            found = f"{total:.1f} s ({each.generate:.1f} + {each.compile:.1f})"
            yield Verdict("robot file to compiled C", each.robot, f"<= {limit:.0f} s", found, total <= limit)
        if each.megabytes is not None:
            met = each.megabytes <= MEGABYTES
            yield Verdict("peak memory of generation", each.robot, "<= 500 MB", f"{each.megabytes:.0f} MB", met)


def _ticks(results: Results) -> Iterator[Verdict]:
    for tick in results.ticks:
        limit = LOOP.get(tick.robot) if tick.work == WORK else TICK.get(tick.robot)
        if limit is not None and (tick.work == WORK or tick.work.endswith("RLS")):
            found = f"{tick.nanoseconds:.0f} ns"
            yield Verdict(f"{tick.work}, one tick", tick.robot, f"<= {limit:.0f} ns", found, tick.nanoseconds <= limit)
