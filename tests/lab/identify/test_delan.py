"""Twenty letters of a planar arm with exact torques: the model must fit to round-off and split the torque rightly."""

from pathlib import Path

import numpy as np
import pytest

import rrrgen
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import read_log
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.identification import Options, identify
from samples.recordings import SHARED

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "delan"
DATA = SHARED / "delan_characters" / "character_data.npz"

pytestmark = pytest.mark.skipif(not DATA.exists(), reason="the letters are not in ../shared/data")

EXACT = 1e-12  # N m, the target; torques are of order 1


def test_letters():
    model = rrrgen.compile(EXAMPLE / "robot.yaml")
    log = read_log(EXAMPLE / "log.yaml", joints=("joint_1", "joint_2"))
    processing = Processing(**log.mapping.processing)
    for split in ("none", "first:0.6"):
        result = identify(model, [log], processing, Options(split=Split.parse(split)))
        beta = result.theta
        assert np.max(np.abs(model.inverse_dynamics(log.q, log.dq, log.ddq, beta) - log.tau)) < EXACT
        assert result.structure.rank == 6
        assert result.indefinite == {"weighted": 0.0, "consistent": 0.0}
    data = np.load(DATA)
    M = model.mass_matrix(log.q, beta)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", M, log.ddq), data["m"], atol=EXACT)
    np.testing.assert_allclose(model.coriolis(log.q, log.dq, beta), data["c"], atol=EXACT)
    np.testing.assert_allclose(model.gravity(log.q, beta), data["g"], atol=EXACT)
