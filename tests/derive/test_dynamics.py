"""Random robots, as derived: the Jacobians of the links, and forward dynamics of links without physical sense.

Every way to every function is compared with the independent dynamics in tests/pipeline/test_random_robots.py.
"""

from __future__ import annotations

import numpy as np
from hypothesis import Phase, given, settings

from derive.comparison import Reference
from oracles.random_robots import arbitrary_link, robots, to_yaml
from rrrgen.base.parallel import without_collection
from rrrgen.derive.functions.dynamics import forward_dynamics
from rrrgen.derive.functions.recording import FunctionBuilder, parametrize
from rrrgen.derive.functions.table import functions_of, recorders
from rrrgen.derive.parameters.base_parameters import base_set
from rrrgen.derive.recursions.link_frames import rational
from rrrgen.program import Program, evaluate
from rrrgen.robot.file import loads_spec
from rrrgen.robot.model import build_model

FINDING = (Phase.explicit, Phase.generate)  # a robot prints as it is; shrinking one would take minutes


@without_collection()
def derived(robot) -> tuple[np.ndarray, dict[str, tuple[Program, ...]]]:
    """The projection K of ``beta = K phi``, and all functions in all ways, without the words about regrouping."""
    model = build_model(loads_spec(to_yaml(robot)))
    own = base_set(model)
    parametrization = parametrize(own, None)
    programs = {
        name: tuple(record(FunctionBuilder(model, parametrization)) for record in recorders(name))
        for name in functions_of("model", robot.n)
        if name != "forward_dynamics"
    }
    recording = FunctionBuilder(model, parametrization)
    programs["forward_dynamics"] = (forward_dynamics(recording, programs["mass_matrix"][0], programs["bias"][0]),)
    K = np.array([[float(rational(v)) for v in row] for row in own.projection]).reshape(-1, 10 * robot.n)
    return K, programs


@settings(max_examples=15, phases=FINDING)
@given(robots(max_joints=4, links="arbitrary"))
def test_forward_dynamics_never_fails_in_silence(robot):
    """With arbitrary parameters M is often indefinite: then status 1 and zeros; else the accelerations are right."""
    K, programs = derived(robot)
    reference = Reference(robot, K, states=6)
    (program,) = programs["forward_dynamics"]
    ddq, status = evaluate(program, *reference.arguments(program))
    definite = np.min(np.linalg.eigvalsh(reference.M), axis=1) > 1e-9 * np.max(np.abs(reference.M), axis=(1, 2))
    indefinite = np.min(np.linalg.eigvalsh(reference.M), axis=1) < -1e-9 * np.max(np.abs(reference.M), axis=(1, 2))
    assert np.all(np.isfinite(ddq))
    assert np.all(status[definite] == 0)
    assert np.all(status[indefinite] == 1)
    assert np.all(ddq[status == 1] == 0)
    recovered = np.einsum("bij,bj->bi", reference.M, ddq) - np.einsum("bij,bj->bi", reference.M, reference.ddq)
    assert np.all(np.abs(recovered[definite]) <= 1e-6 * reference.torque)


def test_arbitrary_links_do_give_indefinite_mass_matrices():
    """What the test above relies on."""
    rng = np.random.default_rng(0)
    tensors = [np.linalg.eigvalsh(arbitrary_link(rng).inertia)[0] for _ in range(20)]
    assert min(tensors) < 0
