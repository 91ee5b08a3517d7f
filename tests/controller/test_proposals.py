"""Proposed gains of the controller: of the filter, and dampings that are stable when sampled."""

from __future__ import annotations

import numpy as np
import pytest

from controller.fault_table import ARMS
from controller.units import Ts
from rrrgen.base.errors import InputError


def test_gains_of_the_filter_are_those_of_the_tuning_and_the_period(rrr, tmp_path):
    import json

    from click.testing import CliRunner

    from rrrgen.cli.generate import generate
    from rrrgen.lab.data.kalman import kalman_matrices

    (tmp_path / "tuning.json").write_text(json.dumps({"var_eta": [1e-10], "var_xi": [1e4]}))
    words = ["--with", "controller", "--modes", "gravity", "--parts", "kalman", "--rate", "500"]
    arguments = [
        "pendulum",
        "-o",
        str(tmp_path / "out"),
        "--tuning",
        str(tmp_path / "tuning.json"),
        "--no-casadi-files",
    ]
    done = CliRunner().invoke(generate, arguments + words)
    assert done.exit_code == 0, done.output
    written = json.loads((tmp_path / "out" / "pendulum_controller.json").read_text())
    defaults = {row["name"]: row["default"] for row in written["structs"]["params"]["fields"]}
    np.testing.assert_allclose(defaults["kalman_gain"], kalman_matrices(0.002, 1e-10, 1e4).k, rtol=1e-15)
    assert defaults["Ts"] == [0.002]
    slow, usual = (
        rrr.controller(modes=["gravity"], parts=["kalman"], Ts=period).params.kalman_gain[0]
        for period in (0.004, 0.001)
    )
    assert slow > usual
    with pytest.raises(InputError, match="accelerations"):
        rrr.controller(parts=["estimator"])


@pytest.mark.parametrize(
    "robot", [ARMS[0], *(pytest.param(arm, marks=pytest.mark.sweep) for arm in ARMS[1:])], ids=["rrr", "Own6", "panda"]
)
def test_proposed_dampings_are_stable_when_sampled(robot):
    from rrrgen.controller.proposals import proposals
    from rrrgen.controller.table import GROUPS, unit_of
    from rrrgen.emit.targets.c_package import derived_model
    from rrrgen.program import evaluate
    from rrrgen.robot.file import read

    model = derived_model(read(robot), GROUPS)[0]
    found = proposals(unit_of(model, parts=[]))
    bounds = [(-3.0, 3.0) if j.limits.lower is None else (j.limits.lower, j.limits.upper) for j in model.spec.joints]
    q = np.random.default_rng(1).uniform(*np.array(bounds, dtype=float).T, (40, len(bounds)))
    M = evaluate(model.programs["mass_matrix"], q, np.broadcast_to(found["beta"], (40, len(found["beta"]))))[0]
    for name in ("stop_damping", "pd_kd", "joint_damping"):
        assert np.abs(np.linalg.eigvals(np.linalg.inv(M) * np.array(found[name]) * Ts)).max() < 1.5
