"""The range of q that the header states: to round-off within a few turns, and how much is lost beyond."""

from __future__ import annotations

import re

import mpmath
import numpy as np
import pytest

import rrrgen
from emit.c_tools import IDENTITY
from pipeline.optimized import bundled
from rrrgen.base.errors import BuildError
from rrrgen.emit.c.robot_files import CBackend

EPS = np.finfo(float).eps
FEW_TURNS = 4 * np.pi
SAMPLES = 60


@pytest.fixture(scope="module", params=[("rrr", "c"), ("scara", "numpy"), ("pendulum", "numpy")], ids=lambda p: p[0])
def arm(request):
    try:
        return rrrgen.compile(*request.param)
    except BuildError as reason:
        pytest.skip(f"no C toolchain: {reason}")


def stated(arm) -> tuple[float, float, float] | None:
    """Rounding per addition, and the loss that the header names for one large angle; None where it names none."""
    header = CBackend().sources(bundled(arm.spec.name), IDENTITY, "double")[f"{arm.spec.name}.h"]
    text = " ".join(re.sub(r"^ \* *", "", header[: header.index("*/")], flags=re.MULTILINE).split())
    found = re.search(r"Range of q joint angles .* up to (\S+) times .* (\S+) rad cost about (\S+) rad", text)
    return tuple(float(number) for number in found.groups()) if found else None


def reduced(q: np.ndarray) -> np.ndarray:
    """Every angle without its whole turns, from 60 digits."""
    with mpmath.workdps(60):
        turn = 2 * mpmath.pi
        return np.array([[float(mpmath.mpf(x) - turn * mpmath.nint(mpmath.mpf(x) / turn)) for x in row] for row in q])


def worst(arm, size: float, seed: int = 3) -> float:
    """The largest error of the tip's axes and of relative torques for angles up to ``size``."""
    q = np.random.default_rng(seed).uniform(-size, size, (SAMPLES, arm.n))
    turning = [joint.is_revolute for joint in arm.spec.joints]
    q[:, ~np.array(turning)] = 0.1
    near = reduced(q)
    T = np.abs(arm.forward_kinematics(q) - arm.forward_kinematics(near))[:, :3, :3]
    tau, other = (arm.inverse_dynamics(x, np.ones_like(q), np.ones_like(q)) for x in (near, q))
    return float(max(T.max(), np.abs(other - tau).max() / np.abs(tau).max()))


def test_what_the_header_states_is_so(arm):
    said = stated(arm)
    assert worst(arm, FEW_TURNS) <= 40 * EPS  # round-off of a dozen operations on angles of a few turns
    if said is None:
        assert arm.spec.name == "pendulum"
        assert worst(arm, 1e6) <= 40 * EPS  # sines of single angles lose nothing
        return
    unit, far, lost = said
    assert unit == pytest.approx(EPS / 2, rel=0.02)
    for size in (1e2, 1e4, 1e6):
        # at most three angles are added, in two additions, and errors of several joints add up in the results
        assert worst(arm, size) <= arm.n * (2 * unit * 3 * size + 20 * EPS)
    assert 0.1 * lost < worst(arm, far) < 10 * lost
