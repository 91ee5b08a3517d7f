"""Random robots before and after all passes: every public function and its nominal twin against independent dynamics.

Each robot is derived once, and its functions are compared as recorded, as optimized and, for some robots, as compiled.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import Phase, given, settings

from derive.comparison import DOUBLE, FRICTION, Reference, failures
from oracles.numeric_rank import base_parameter_count
from oracles.random_robots import random_robot, robots, to_yaml
from rrrgen.base.parallel import without_collection
from rrrgen.derive import derive_model
from rrrgen.derive.functions.table import functions_of
from rrrgen.derive.optimizer import Optimizer
from rrrgen.robot.file import loads_spec
from rrrgen.robot.identity import identify
from rrrgen.runtime.load import load_model
from rrrgen.verify import verify
from samples.draws import draws

SINGLE = 1e-4  # relative to the largest value; hundreds of roundings of 6e-8 with cancellation
FINDING = (Phase.explicit, Phase.generate)  # a robot prints as it is; shrinking one would take minutes

# joints -> robots: with the compiled ones 15 in all; most of them small, since the time grows with the joints' square
SIZES = {1: 1, 2: 3, 3: 3, 4: 2, 5: 1, 6: 1, 7: 1}
SAMPLES = 25  # states for singular values: 25 n rows for 10 n columns


@without_collection()
def derived(robot, states=2):
    """The optimized model of a robot and its reference, after a comparison of every program, recorded and optimized."""
    recorded = derive_model(loads_spec(to_yaml(robot)))
    reference = Reference(robot, np.array(recorded.base_projection), states)
    ways = {name: programs for name, programs in recorded.alternatives.items() if name not in FRICTION}
    assert failures(reference, ways) == {}
    assert len(reference.K) == base_parameter_count(robot, SAMPLES).rank
    optimized = Optimizer()(recorded)
    programs = {name: (program,) for name, program in optimized.programs.items() if name not in FRICTION}
    with_parameters = {name for name in programs if f"{name}_nominal" in programs}
    assert set(functions_of("model", robot.n)) - FRICTION <= set(programs)
    assert {"mass_matrix", "inverse_dynamics", "forward_dynamics"} <= with_parameters
    assert failures(reference, programs) == {}
    return optimized, reference


@pytest.mark.parametrize("joints", SIZES)
@pytest.mark.sweep(but=["1", "2", "4", "6"])
def test_every_recorded_and_every_optimized_function_equals_the_independent_dynamics(joints):
    """Prismatic joints, coincident and parallel axes, odd twists, tilted or no gravity, base and tool frames.

    The base parameters are as many as the rank of the regressor, at singular values.
    """

    @settings(max_examples=draws(SIZES[joints]), phases=FINDING)
    @given(robots(min_joints=joints, max_joints=joints))
    def compare(robot):
        derived(robot)

    compare()


@pytest.mark.sweep(but=["1"])
@pytest.mark.parametrize("joints", [1, 3, pytest.param(4, marks=pytest.mark.sweep)])
def test_every_compiled_function_equals_the_independent_dynamics(joints):
    """All functions and twins through C; tests/emit/test_c_random_robots.py runs some of them on more robots.

    In both precisions for every other robot, since they are printed alike for any. The model in Python is verified
    besides, with what it computes from these functions.
    """
    optimized, reference = derived(random_robot(7000 + joints, n=joints), states=5)
    precisions = (("double", DOUBLE), ("float", SINGLE))
    for real, tolerance in precisions if joints % 2 == 0 else precisions[:1]:
        model = load_model(optimized, identify(optimized.spec), real=real)
        model.engine.prepare()
        for name in set(optimized.programs) - FRICTION:
            program = optimized.programs[name]
            outputs = tuple(np.asarray(v, float) for v in model.engine.call(name, reference.arguments(program)))
            error = reference.error(name.removesuffix("_nominal"), outputs)
            assert error <= tolerance, (name, real, error)
    report = verify(load_model(optimized, identify(optimized.spec), "numpy"), samples=5, libraries=False)
    assert report.ok, report.to_text()
