"""Friction of one joint as a function: from arrays without files, with the numbers of the command."""

import pytest

import rrrgen
from lab.studies.commands import assert_same_files, printed_json
from rrrgen.lab.data.recordings import Log
from samples.recordings import write_log
from samples.stick_slip_joint import Joint, record


@pytest.fixture(scope="module")
def arrays():
    """A recording of the pendulum."""
    found = record(Joint("coulomb_viscous"), duration=16.0, seed=3, substeps=2, torque_noise=0.01, centred=True)
    return {"t": found["t"], "q": found["q"][:, None], "tau": found["tau"][:, None]}


@pytest.mark.usefixtures("no_figures")
def test_arrays_give_the_numbers_of_the_command(arrays, tmp_path, capsys):
    result = rrrgen.estimate_friction("pendulum", arrays, joint="q1", laws="coulomb_viscous", seed=2)
    write_log(tmp_path / "log.csv", Log(joints=("q1",), **arrays))
    words = ["--joint", "q1", "--law", "coulomb_viscous", "--seed", 2, "-o", tmp_path / "run"]
    code = printed_json(capsys, "experiment", "friction", "pendulum", "--log", tmp_path / "log.csv", *words)
    assert code == (0, result.to_json())
    result.save(tmp_path / "saved")
    assert_same_files(tmp_path / "run", tmp_path / "saved", but=("run.json",))
    assert result.law == "coulomb_viscous"
    assert result.values["coulomb"] == pytest.approx(Joint().coulomb, rel=0.02)
    assert result.std["coulomb"] < 0.02 * result.values["coulomb"]
    assert result.spec.joints[0].friction is not None
    assert "* coulomb_viscous" in repr(result)
    assert "viscous" in result._repr_html_()
    assert result.plot("friction").axes


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"joint": "q1", "laws": "stribek"}, "did you mean 'stribeck'"),
        ({"joint": "q7"}, "has no joint 'q7'"),
    ],
)
def test_options_that_make_no_sense_are_refused(arrays, options, message):
    with pytest.raises(rrrgen.InputError, match=message):
        rrrgen.estimate_friction("pendulum", arrays, **options)
