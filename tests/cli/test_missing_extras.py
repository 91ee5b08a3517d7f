"""What is not installed: exit code 5 and the line that installs it, before any work, never an internal fault."""

import json
import shutil
import sys

import numpy as np
import pytest

from rrrgen.base.errors import EXTRAS, MissingExtraError
from rrrgen.cli.commands import COMMANDS, GROUPS
from rrrgen.cli.main import run
from rrrgen.lab.data.mapping import FileSource
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.data.tables.formats import open_here
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.robot.robots import bundled_path
from samples.recordings import write_log
from tests.robot.file.test_ur_calibration import FAR_AWAY


class Hider:
    """Among the finders of modules: some packages are not there."""

    def __init__(self, packages):
        self.packages = packages

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in self.packages:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def hide(monkeypatch, *packages):
    for name in [name for name in sys.modules if name.partition(".")[0] in packages]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Hider(packages), *sys.meta_path])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recording of a pendulum, a motion, and a tuning."""
    place = tmp_path_factory.mktemp("extras")
    t = 0.01 * np.arange(300)
    q = np.sin(2 * t)[:, None]
    write_log(place / "log.csv", Log(("q1",), t, q, 3 * q, period=0.01))
    motion = FourierTrajectory.from_coefficients(np.full((5, 1), 0.1), 0.5)
    (place / "motion.json").write_text(json.dumps(motion.to_json()))
    (place / "tuning.json").write_text(json.dumps({"var_eta": [1e-8], "var_xi": [1.0]}))
    return place


USES = {
    "experiment excite": (["pendulum", "-o", "x"], ("casadi", "matplotlib")),
    "experiment excite on a cluster": (
        ["pendulum", "--cluster", "tcp://localhost:1", "-o", "x"],
        ("dask", "distributed"),
    ),
    "identify": (
        ["pendulum", "--log", "log.csv", "-o", "x"],
        ("scipy", "matplotlib", "cvxpy", "clarabel"),
    ),
    "identify on a cluster": (
        ["pendulum", "--log", "log.csv", "--cluster", "tcp://localhost:1", "-o", "x"],
        ("dask", "distributed"),
    ),
    "experiment validate": (["pendulum", "--log", "log.csv", "-o", "x"], ("scipy", "matplotlib")),
    "experiment simulate": (["pendulum", "--trajectory", "motion.json", "-o", "x"], ("scipy",)),
    "experiment reconstruct": (["log.csv", "-o", "x"], ("scipy", "matplotlib")),
    "experiment friction": (["pendulum", "--log", "log.csv", "--joint", "q1", "-o", "x"], ("scipy", "matplotlib")),
    "experiment payload": (["pendulum", "--log", "log.csv", "-o", "x"], ("scipy", "cvxpy", "clarabel")),
    "experiment drive-gains": (
        ["pendulum", "--log", "log.csv", "--loaded", "l.csv", "--mass", "1", "-o", "x"],
        ("scipy",),
    ),
    "experiment elastic-joints": (["pendulum", "--log", "log.csv", "-o", "x"], ("scipy",)),
    "experiment contact-thresholds": (["pendulum", "--log", "log.csv", "-o", "x"], ("scipy",)),
    "response linearise": (["pendulum", "--log", "log.csv", "--response", "motion.json", "-o", "x"], ("scipy",)),
    "calibrate": (["planar2r", "--poses", "motion.json", "--figure", "x", "-o", "x"], ("matplotlib",)),
    "response frf": (["response.yaml", "-o", "x"], ("scipy", "matplotlib")),
    "response matrix": (["pendulum", "--log", "log.csv", "--period", "1", "-o", "x"], ("scipy", "matplotlib")),
    "response model": (["response.yaml", "-o", "x"], ("scipy", "matplotlib")),
    "response vibration": (["--mode", "28:0.1", "--rate", "1000", "-o", "x"], ("scipy", "matplotlib")),
    "experiment case-study": (["-o", "x"], ("casadi", "scipy", "matplotlib", "cvxpy", "clarabel")),
    "generate": (["pendulum", "--casadi-files", "-o", "x"], ("casadi",)),
    "generate with a filter": (["pendulum", "--no-casadi-files", "--tuning", "tuning.json", "-o", "x"], ("scipy",)),
}


def words_of(use: str) -> list[str]:
    """The words that call the command of a use, such as "experiment excite in parallel"."""
    words = use.split()
    return words[:2] if words[0] in GROUPS else words[:1]


CASES = [(use, package) for use, (_, packages) in USES.items() for package in packages]


@pytest.mark.parametrize(("use", "package"), CASES)
def test_a_command_names_the_extra_that_it_lacks(use, package, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    hide(monkeypatch, package)
    code, message = run([*words_of(use), *USES[use][0]]), capsys.readouterr().err
    assert code == 5, message
    assert package in message
    extra = "casadi" if use == "generate" else EXTRAS[package]
    assert f"pip install 'rrrgen[{extra}]'" in message
    assert not (folder / "x").exists(), "something was written"


PLAIN = {
    "new": ["arm"],
    "import": ["ur.yaml", "-o", "imported.yaml"],
    "robots": [],
    "check": ["pendulum.yaml"],
    "show": ["pendulum"],
    "generate": ["pendulum", "-o", "out", "--trajectory", "motion.json", "--friction", "lugre"],
    "verify": ["pendulum"],
    "ik": ["planar2r", "--pose", "0.3 0.2 0"],
    "schema": [],
    "export": ["pendulum", "--to", "urdf"],
    "calibrate": ["planar2r", "--choose", "5", "-o", "poses.csv"],
    "doctor": [],
    "certify": ["pendulum", "-o", "certified"],
    "playground": ["--help"],  # it serves until it is interrupted
}


def test_every_command_is_tried():
    assert set(PLAIN) | {" ".join(words_of(use)) for use in USES} == set(COMMANDS)


@pytest.mark.parametrize("command", PLAIN)
def test_commands_that_need_no_extra_work_without_any(command, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    shutil.copy(bundled_path("pendulum"), folder)
    (folder / "ur.yaml").write_text(FAR_AWAY, encoding="utf-8")
    hide(monkeypatch, *EXTRAS)
    code = run([command, *PLAIN[command]])
    assert code == 0, capsys.readouterr().err
    assert not list(folder.rglob("*.casadi"))


@pytest.mark.parametrize(("file", "package"), [("a.h5", "h5py"), ("a.parquet", "pyarrow"), ("a.mcap", "rosbags")])
def test_recordings_name_the_extra_that_reads_them(file, package, folder, monkeypatch):
    (folder / file).write_bytes(b"not read")
    hide(monkeypatch, package)
    with pytest.raises(MissingExtraError, match=r"rrrgen\[logs\]"):
        open_here(FileSource("log", folder / file))
