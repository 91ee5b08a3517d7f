"""A payload as a function: from arrays without files, with the numbers of the command."""

import numpy as np
import pytest

import rrrgen
from lab.studies.commands import assert_same_files, printed_json
from rrrgen.lab.data.recordings import Log
from samples.recordings import fourier_motion, write_log

MASS, COM = 1.5, [0.1, 0.0, 0.0]


def recording(carried):
    """Torques of planar2r, carrying a point mass or nothing, with a little noise."""
    model = rrrgen.compile("planar2r")
    t = 0.01 * np.arange(1000)
    q, dq, ddq = fourier_motion(t, 2, seed=4)
    beta = model.add_payload(MASS, COM, np.zeros((3, 3))) if carried else model.beta
    tau = model.inverse_dynamics(q, dq, ddq, beta)
    return {"t": t, "q": q, "tau": tau + 0.01 * np.random.default_rng(1).normal(size=tau.shape)}


def test_arrays_give_the_numbers_of_the_command(tmp_path, capsys):
    pytest.importorskip("cvxpy")
    arrays = recording(carried=True)
    result = rrrgen.estimate_payload("planar2r", arrays, keep_friction=True)
    write_log(tmp_path / "log.csv", Log(joints=("q1", "q2"), **arrays))
    command = [
        "experiment",
        "payload",
        "planar2r",
        "--log",
        tmp_path / "log.csv",
        "-o",
        tmp_path / "run",
        "--keep-friction",
    ]
    assert printed_json(capsys, *command) == (0, result.to_json())
    result.save(tmp_path / "saved")
    assert_same_files(tmp_path / "run", tmp_path / "saved", but=("run.json",))
    assert float(result["mass"]) == pytest.approx(MASS, rel=0.01)
    assert float(rrrgen.compile(result.spec).beta[0]) != rrrgen.compile("planar2r").beta[0]
    assert "mass" in repr(result)
    assert result._repr_html_().count("<tr>") == 11


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tau": lambda tau: 1e-3 * tau}, "no payload explains the torques: "),  # read in kN m
        ({"q": np.degrees}, "no payload explains the torques: "),
        ({"tau": lambda tau: tau * [1.0, -1.0]}, "no payload explains the torques: "),
        ({"tau": lambda tau: 0.0 * tau}, "all torques of the recordings are zero"),
    ],
    ids=["kN m", "degrees", "sign", "zero"],
)
def test_torques_that_no_payload_explains_are_refused(change, message):
    """Torques in kN m gave a payload, at a relative error of 1e5 %; the others had none, since joints did not move."""
    pytest.importorskip("cvxpy")
    arrays = recording(carried=True)
    with pytest.raises(rrrgen.DerivationError, match=message):
        rrrgen.estimate_payload("planar2r", arrays | {name: made(arrays[name]) for name, made in change.items()})


def test_a_clock_in_milliseconds_is_diagnosed():
    pytest.importorskip("cvxpy")
    arrays, found = recording(carried=True), []
    rrrgen.estimate_payload("planar2r", arrays | {"t": 1e3 * arrays["t"]}, findings=found.append)
    assert any("the clock is in ms" in getattr(finding, "cause", "") for finding in found)


def test_an_unknown_option_is_refused():
    with pytest.raises(rrrgen.InputError, match="did you mean 'keep_friction'"):
        rrrgen.estimate_payload("planar2r", {}, keep_fricton=True)
