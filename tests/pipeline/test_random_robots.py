"""Random robots after all passes: every public function and its nominal twin against the independent dynamics."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import Phase, given, settings

from derive.comparison import DOUBLE, FRICTION, Reference, failures
from oracles.random_robots import random_robot, robots, to_yaml
from rrrgen import pipeline
from rrrgen.derive.functions.table import FUNCTIONS
from rrrgen.output.manifest import identify
from rrrgen.robotfile import loads_spec
from rrrgen.runtime.load import load_model

SINGLE = 1e-4  # relative to the largest value; hundreds of roundings of 6e-8 with cancellation
FINDING = (Phase.explicit, Phase.generate)  # a robot prints as it is; shrinking one would take minutes

# joints -> robots: 50 in all
SIZES = {1: 6, 2: 12, 3: 12, 4: 8, 5: 6, 6: 4, 7: 2}


@pytest.mark.parametrize("joints", SIZES)
def test_every_optimized_function_equals_the_independent_dynamics(joints):
    @settings(max_examples=SIZES[joints], phases=FINDING)
    @given(robots(min_joints=joints, max_joints=joints))
    def compare(robot):
        derived = pipeline.derive(loads_spec(to_yaml(robot)))
        programs = {name: (program,) for name, program in derived.programs.items() if name not in FRICTION}
        with_parameters = {name for name in programs if f"{name}_nominal" in programs}
        assert (set(FUNCTIONS) | {"forward_dynamics"}) - FRICTION <= set(programs)
        assert {"mass_matrix", "inverse_dynamics", "forward_dynamics"} <= with_parameters
        assert failures(Reference(robot, np.array(derived.base_projection)), programs) == {}

    compare()


@pytest.mark.parametrize("joints", [1, 2, 3, 4, 5, 6])
def test_every_compiled_function_equals_the_independent_dynamics(joints):
    """All functions and twins through C in both precisions; tests/backends runs some of them on thirty more robots."""
    robot = random_robot(7000 + joints, n=joints)
    spec = loads_spec(to_yaml(robot))
    derived = pipeline.derive(spec)
    reference = Reference(robot, np.array(derived.base_projection), states=5)
    for real, tolerance in (("double", DOUBLE), ("float", SINGLE)):
        engine = load_model(derived, identify(spec), real=real).engine
        engine.prepare()
        for name in set(derived.programs) - FRICTION:
            program = derived.programs[name]
            outputs = tuple(np.asarray(v, float) for v in engine.call(name, reference.arguments(program)))
            error = reference.error(name.removesuffix("_nominal"), outputs)
            assert error <= tolerance, (name, real, error)
