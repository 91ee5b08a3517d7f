"""Second derivatives are timed beside CasADi's; results that differ are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("casadi", reason="CasADi is the rival")

from bench.contenders.cases import make_case
from bench.contenders.contender import HAND_FILE, OURS_FILE, Contender, DisagreementError
from bench.measurements.race import Effort
from bench.measurements.second_derivatives import FUNCTIONS, _check, measured
from bench.toolchain import find_toolchain
from rrrgen.robot.file import load_spec


def test_hessian_and_product_are_timed_beside_casadi():
    toolchain = replace(find_toolchain(("-O1",)), cxx=None)
    rows = measured(make_case(load_spec("rrr")), toolchain, Effort(rounds=1, sample=1e3, counted=1))
    assert [row.function for row in rows] == list(FUNCTIONS)
    assert all(row.nanoseconds > 0.0 for row in rows)
    assert [row.casadi is None for row in rows] == [False, False, True]
    assert [row.pinocchio for row in rows] == [None, None, None]  # without a C++ compiler


def test_results_that_differ_are_refused():
    both = [Contender(label, FUNCTIONS[0], 2, "", "file") for label in (OURS_FILE, HAND_FILE)]
    with pytest.raises(DisagreementError, match=r"rrr: inverse_dynamics_hessian of .* differs by 5\.0e-01"):
        _check("rrr", both, [np.array([[1.0, 2.0]]), np.array([[1.0, 1.0]])])
