"""Shared by every test: the oracles are importable as `oracles.<module>`, and Hypothesis runs reproducibly."""

import os
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

TESTS = Path(__file__).resolve().parent
if str(TESTS) not in sys.path:  # import modes other than "prepend" do not do this
    sys.path.insert(0, str(TESTS))

# Robots are slow to draw and their evaluation time varies with n, so deadlines would only measure the machine's load.
# "ci" is derandomised: a red run can be repeated; "explore" searches with fresh seeds.
_common = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large]}
settings.register_profile("ci", derandomize=True, max_examples=50, **_common)
settings.register_profile("explore", max_examples=500, **_common)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


@pytest.fixture(autouse=True)
def coarse_pictures(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """PNG files of a low resolution, which take a fifth of the time; a test that asks for print resolution has it."""
    if "print_resolution" not in request.fixturenames:
        monkeypatch.setattr("rrrgen.runs.figures.PRINT", 60)


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands draw no figures, which take most of their time: for tests beside one that draws the same figures."""
    monkeypatch.setattr("rrrgen.runs.run_folder.RunFolder.figure", lambda folder, name, figure: [])


@pytest.fixture
def print_resolution() -> None:
    """Figures as users get them."""
