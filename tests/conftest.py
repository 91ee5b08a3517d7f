"""Shared by every test: the oracles are importable as `oracles.<module>`, and Hypothesis runs reproducibly."""

import gc
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import HealthCheck, settings

from rrrgen.base import parallel
from rrrgen.base.files import write_file
from rrrgen.lab.data import figure_style as figures
from rrrgen.lab.data.run_folder import RunFolder
from samples.draws import draws

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TESTS = Path(__file__).resolve().parent
if str(TESTS) not in sys.path:  # import modes other than "prepend" do not do this
    sys.path.insert(0, str(TESTS))

# The C of most tests is built at -O0, in a quarter of the time: without contraction no level of optimization changes a
# bit (tests/runtime/test_compilers.py). What only the optimizer may find is left to tests that name a level.
os.environ.setdefault("RRRGEN_CFLAGS", "-O0")

# Tests start many processes, which would compile every module anew where the environment forbids to keep byte code.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

os.environ.pop("COLUMNS", None)  # processes of pytest-xdist have it: commands would fold what they print into a pipe

# Tests run on all processors: commands compute in the process of the test, where more processes would import everything
# and derive again what this one has derived. Tests of several processes name their number.
parallel.MAX_JOBS = 1

# A full test process holds millions of objects, which the default thresholds have the collector visit again and again:
# rarer visits save 7 % of the time.
gc.set_threshold(100_000, 20, 20)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the tests that are marked ``sweep`` to `make sweep`, and to those who name one."""
    if draws(1) > 1 or any("::" in word for word in config.args):
        return
    unknown = {(item.nodeid.partition("[")[0], variant) for item in items for variant in _kept(item)}
    unknown -= {(item.nodeid.partition("[")[0], _variant(item)) for item in items}
    if unknown:
        raise pytest.UsageError(f"sweep(but=[...]) names variants that do not exist: {sorted(unknown)}")
    left = [item for item in items if item.get_closest_marker("sweep") and _variant(item) not in _kept(item)]
    if left:
        config.hook.pytest_deselected(items=left)
        gone = set(left)
        items[:] = [item for item in items if item not in gone]


def _variant(item: pytest.Item) -> str:
    """The id of the parameters of a test, as it stands in brackets."""
    return item.callspec.id if hasattr(item, "callspec") else ""


def _kept(item: pytest.Item) -> Sequence[str]:
    """The variants that a test marked ``sweep(but=[...])`` leaves in an ordinary run."""
    mark = item.get_closest_marker("sweep")
    return mark.kwargs.get("but", ()) if mark else ()


# Robots are slow to draw and their evaluation time varies with n, so deadlines would only measure the machine's load.
# "ci" is derandomised: a red run can be repeated; "explore", of `make sweep`, searches with fresh seeds.
_common = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large]}
settings.register_profile("ci", derandomize=True, max_examples=25, **_common)
settings.register_profile("explore", max_examples=500, **_common)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


@pytest.fixture(scope="session", autouse=True)
def print_dots_per_inch() -> Iterator[int]:
    """PNG files of a low resolution, which take a fifth of the time; the resolution that users get.

    For the session, since fixtures of modules draw figures before anything that belongs to a single test.
    """
    with pytest.MonkeyPatch.context() as patch:
        dots_per_inch = figures.PRINT
        patch.setattr(figures, "PRINT", 60)
        yield dots_per_inch


@pytest.fixture(scope="session", autouse=True)
def one_figure_of_a_name(print_dots_per_inch: int) -> Iterator[Callable[..., list[Path]]]:
    """Run folders draw the first figure of a name in each process; later ones are made, and get the files of the first.

    To draw them takes a fifth of the time of the tests that identify.
    """
    drawn: dict[str, list[tuple[str, bytes]]] = {}
    draw = RunFolder.figure

    def figure(folder: RunFolder, name: str, made: "Figure") -> list[Path]:
        if name not in drawn:
            paths = draw(folder, name, made)
            drawn[name] = [(path.name, path.read_bytes()) for path in paths]
            return paths
        place = folder.path / "figures"
        for file, content in drawn[name]:
            write_file(place / file, content)
        return [place / file for file, _ in drawn[name]]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunFolder, "figure", figure)
        yield draw


@pytest.fixture
def every_figure(monkeypatch: pytest.MonkeyPatch, one_figure_of_a_name: Callable[..., list[Path]]) -> None:
    """Run folders draw every figure: for tests of what a figure shows."""
    monkeypatch.setattr(RunFolder, "figure", one_figure_of_a_name)


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands draw no figures, which take most of their time: for tests beside one that draws the same figures."""
    monkeypatch.setattr("rrrgen.lab.data.run_folder.RunFolder.figure", lambda folder, name, figure: [])


@pytest.fixture
def print_resolution(monkeypatch: pytest.MonkeyPatch, print_dots_per_inch: int) -> None:
    """Figures as users get them."""
    monkeypatch.setattr(figures, "PRINT", print_dots_per_inch)
