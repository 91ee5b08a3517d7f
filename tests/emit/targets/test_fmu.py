"""The FMU: valid, warning-free, and the same motion in both modes as an independent integration."""

from __future__ import annotations

import shutil
import zipfile

import numpy as np
import pytest

from emit.targets.arm import arm
from emit.targets.rrr_library import STRICT, run
from pages.test_pages import blocks
from rrrgen.base.errors import DerivationError
from rrrgen.emit.targets.interface import ExportOptions
from rrrgen.exporting import export_robot
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters

fmpy = pytest.importorskip("fmpy", reason="needs FMPy to load an FMU")

STOP = 0.4
START = {"q[1]": 0.3, "q[2]": -0.8, "dq[1]": 1.0, "torque[1]": -5.0, "torque[2]": 1.5, "friction_width[1]": 0.05}


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    files = export_robot(arm(), "fmu").files
    place = tmp_path_factory.mktemp("fmu")
    (place / "arm.fmu").write_bytes(files["arm.fmu"])
    (place / "README.md").write_text(files["README.md"], encoding="utf-8")
    return place / "arm.fmu"


def integrated() -> np.ndarray:
    """Positions and speeds at the end, by SciPy from the built-in Newton-Euler recursion and the laws as stated."""
    integrate = pytest.importorskip("scipy.integrate")
    reference = NewtonEuler(chain_of(arm()), nominal_parameters(arm()))
    viscous, coulomb, width = np.array([0.4, 0.2]), np.array([0.6, 0.3]), np.array([0.05, 0.01])
    torque = np.array([-5.0, 1.5])

    def rate(_t: float, x: np.ndarray) -> np.ndarray:
        q, dq = x[:2], x[2:]
        accelerations = np.vstack([np.zeros(2), np.eye(2)])
        bias, *columns = reference.inverse_dynamics(*(np.tile(each, (3, 1)) for each in (q, dq)), accelerations)
        friction = viscous * dq + coulomb * np.tanh(dq / width)
        return np.concatenate([dq, np.linalg.solve(np.stack(columns, 1) - bias[:, None], torque - friction - bias)])

    start = [START["q[1]"], START["q[2]"], START["dq[1]"], 0.0]
    return integrate.solve_ivp(rate, (0, STOP), start, rtol=1e-9, atol=1e-9, method="DOP853").y[:, -1]


def test_both_modes_follow_an_independent_integration(fmu):
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(fmu)) == []
    expected = integrated()
    folder = fmpy.extract(str(fmu))
    outputs = ["q[1]", "q[2]", "dq[1]", "dq[2]"]
    for mode, error in (("CoSimulation", 1e-7), ("ModelExchange", 2e-6)):
        found = fmpy.simulate_fmu(
            folder, stop_time=STOP, fmi_type=mode, output=outputs, output_interval=0.02, start_values=START,
            relative_tolerance=1e-9,
        )  # fmt: skip
        last = np.array([found[-1][name] for name in outputs])
        np.testing.assert_allclose(last, expected, atol=error, err_msg=mode)
    said: list[str] = []
    zeros = {f"beta[{k}]": 0.0 for k in range(1, 5)} | {"Ia[1]": 0.0, "Ia[2]": 0.0}
    with pytest.raises(Exception, match="fmi2"):
        fmpy.simulate_fmu(folder, stop_time=STOP, start_values=zeros, logger=lambda *words: said.append(str(words[-1])))
    assert any("not positive definite" in each for each in said)
    shutil.rmtree(folder)


def test_its_sources_have_no_warnings(fmu, tmp_path):
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    run("gcc", "-std=c99", *STRICT, "-fsyntax-only", "arm_fmu.c", cwd=tmp_path / "sources")


def test_the_readme_is_right(fmu, tmp_path, monkeypatch):
    """Its program runs beside the FMU, and its command builds the library anew from the sources."""
    text = (fmu.parent / "README.md").read_text(encoding="utf-8")
    (program,), (command,) = blocks(text, "python"), blocks(text, "sh")
    monkeypatch.chdir(fmu.parent)
    space: dict = {}
    exec(program, space)  # our own page
    assert space["result"]["q[1]"][0] == 0.5
    assert space["result"]["time"][-1] == pytest.approx(1.0)
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    library = next((tmp_path / "binaries").rglob("arm.so"), None)
    if library is not None:  # this is Linux
        library.unlink()
        run("sh", "-ec", command, cwd=tmp_path)
        assert library.is_file()


def test_what_has_no_fmu_is_refused():
    with pytest.raises(DerivationError, match=r"FMI 2\.0 has no platform for macos-arm64"):
        export_robot(arm(), "fmu", options=ExportOptions(platforms=("macos-arm64",)))
