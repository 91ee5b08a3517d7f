"""The control loop in C: five times the accuracy of PD with gravity, the same in MuJoCo, and calm at rest."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import rrrgen
from examples.script import script


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return script("control_loop")


@pytest.fixture(scope="module")
def program(example: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return example.build(tmp_path_factory.mktemp("control_loop"))


def test_the_model_makes_the_loop_accurate(example: ModuleType, program: Path) -> None:
    model = rrrgen.compile("rrr")
    motion = example.reference(model)
    assert example.BANDWIDTH * example.PERIOD * example.largest_eigenvalue(model, motion) < 0.16
    error = {law: example.rms(example.run(program, law, motion), motion) for law in example.LAWS}
    assert error["pd"] > 5 * error["pd_gravity"] > 25 * error["computed_torque"]
    assert error["feedforward"] < 1.2 * error["computed_torque"]
    short = motion[:1500]
    other = example.in_mujoco(model, "computed_torque", short, program.parent)
    if other is not None:
        assert example.rms(other, short) == pytest.approx(
            example.rms(example.run(program, "computed_torque", short), short), rel=0.2
        )


def test_the_sign_of_a_measured_speed_shakes_the_arm_at_rest(example: ModuleType, program: Path) -> None:
    still = np.hstack([np.tile([0.3, -1.0, 0.8], (3000, 1)), np.zeros((3000, 6))])
    swing = {law: np.ptp(example.run(program, law, still)[1000:, 2]) for law in ("resting_measured", "resting_desired")}
    assert swing["resting_measured"] > 5 * swing["resting_desired"]
    assert swing["resting_desired"] < 1e-3
