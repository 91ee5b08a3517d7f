"""The friction study on files recorded from the independent plant of the oracles: units, signs, columns, truth."""

from dataclasses import replace

import numpy as np
import pytest

from lab.friction.independent import errors, run_case
from lab.friction.independent_cases import CASES, reference
from oracles.sliding_joint import SampledLoop, SlidingJoint, simulate
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.friction.estimation import estimate_friction
from rrrgen.lab.friction.joint_recording import joint_data
from rrrgen.robot.file import load_spec

pytestmark = pytest.mark.usefixtures("no_figures")
QUICK = {"seconds": 15.1, "loop": SampledLoop(period=2e-3, delay=1, noise=0.005)}


@pytest.mark.sweep(but=["asymmetric, motor side-laws0-", "stribeck, offset-laws1-"])
@pytest.mark.parametrize(
    ("name", "laws", "note"),
    [
        ("asymmetric, motor side", ("asymmetric", "coulomb_viscous"), ""),
        ("stribeck, offset", ("stribeck",), ""),
        ("coulomb_viscous, no gravity, offset", ("asymmetric", "coulomb_viscous"), "cannot tell these apart"),
    ],
)
def test_the_truth_is_found_in_files_of_every_kind(name, laws, note, tmp_path):
    case = replace(CASES[name], **QUICK)
    record = run_case(case, 2, tmp_path, tuple(word for law in laws for word in ("--law", law)))
    assert record["chosen"] == case.joint.law
    assert [note in each for each in record["notes"] if "add slow reversals" not in each] == [True] * bool(note)
    assert record["delay"] == pytest.approx(2e-3, abs=1e-4)
    table = errors(case, record)
    assert {"inertia"} | ({"offset"} if case.joint.constant else set()) <= set(table)
    for parameter, (relative, deviations, limit) in table.items():
        assert relative < (limit or 0.02), parameter
        assert deviations < 4.0, parameter
    written = load_spec(str(tmp_path / "run" / "results" / "robot.yaml")).joints[0].friction
    assert (written.offset or 0.0) == pytest.approx(case.joint.constant, abs=0.005)


def estimated(case, seed, gravity, law):
    """The estimate of one law from a quick recording of the case."""
    case = replace(case, **QUICK)
    made = simulate(case.joint, case.loop, reference(case, seed), seed)
    data = joint_data(Log(("q",), made["t"], made["q"][:, None], made["tau"][:, None]), "q")
    return estimate_friction(data, gravity, (law,)).chosen


@pytest.mark.parametrize("constant", [0.3, 0.0])
def test_an_offset_of_the_torque_is_no_gravity(constant):
    """Without a parameter of its own it biased gravity by 92 deviations, and its angle with it."""
    case = CASES["coulomb_viscous, noise"]
    case = replace(case, joint=replace(case.joint, constant=constant))
    values, std = (getattr(estimated(case, 2, 2, "coulomb_viscous"), what) for what in ("values", "std"))
    joint = case.joint
    for name, value in (("offset", constant), ("gravity", joint.gravity), ("coulomb", joint.coulomb)):
        assert abs(values[name] - value) < 4.0 * std[name], name
    assert std["offset"] < 0.01


def test_unstable_motion_at_speeds_that_are_not_slow_does_not_mislead():
    """Slower than the Stribeck speed an error grows like e^(57 t): in windows of .2 s viscous friction was 36 % off."""
    case = replace(CASES["stribeck"], joint=SlidingJoint("stribeck", hang=0.4), fast=0.3, slow=0.06)
    found = estimated(case, 1, 2, "stribeck")
    assert found.score.held_out < 1.1
    for name, value in (("inertia", 0.066), ("viscous", 0.12), ("coulomb", 0.6), ("stiction_excess", 0.35)):
        assert found.values[name] == pytest.approx(value, rel=0.02), name


def test_the_plant_obeys_its_equation():
    """A frictionless pendulum keeps its energy, and a torque below break-away does not move a resting joint."""
    t = np.arange(2000) * 1e-3
    free = SlidingJoint("coulomb_viscous", coulomb=0.0, viscous=0.0)
    held = SampledLoop(bandwidth=1e-12, resolution=0.0)
    found = simulate(free, held, (t, np.full_like(t, 1.0), 0.0 * t))
    energy = 0.5 * free.inertia * found["v"] ** 2 - free.gravity * np.cos(found["q"])
    assert np.ptp(energy) < 1e-9
    assert np.ptp(found["q"]) > 1.9
    resting = SlidingJoint("stribeck", gravity=0.0)
    found = simulate(resting, SampledLoop(), (t, 0.0 * t + 0.005 * (t > 0.5), 0.0 * t))
    assert 0.0 < np.max(np.abs(found["tau"])) < resting.coulomb + resting.excess
    assert np.all(found["v"] == 0.0)
