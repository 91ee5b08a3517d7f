"""Figures of an identification: units, what is held out, long recordings, friction over speed."""

import numpy as np
import pytest

import rrrgen
from rrrgen.lab.data.kalman import kalman_matrices
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.data.run_folder import RunFolder
from rrrgen.lab.estimate.tsqr import Rows
from rrrgen.lab.identify import identification
from rrrgen.lab.identify.cross_validation import convergence
from rrrgen.lab.identify.diagnosis.trial_fits import Sample
from rrrgen.lab.identify.figures import force_units, plot_bode, plot_convergence, plot_friction, torque_curves
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.lab.identify.parameters import Column, DriveTerms
from rrrgen.lab.identify.results import write_identification
from samples.recordings import fourier_motion


@pytest.fixture(scope="module")
def case():
    arm = rrrgen.compile("planar2r")
    t = 0.01 * np.arange(1500)
    q, dq, ddq = fourier_motion(t, 2, 5)
    tau = np.array(arm.inverse_dynamics(q, dq, ddq)) + 0.5 * np.sign(dq) + 0.2 * dq
    tau += 0.05 * np.random.default_rng(0).normal(size=q.shape)
    return arm, Log(("q1", "q2"), t, q, tau, dq=dq, ddq=ddq, period=0.01)


def found(case, **options):
    arm, log = case
    terms = DriveTerms.everywhere(2, "viscous", "coulomb")
    return identify(arm, [log], Processing("logged", decimate=1), Options(terms=terms, poses=2, **options))


def test_nothing_vanishes_where_the_rows_do_not_fit_in_memory(case, tmp_path, monkeypatch):
    arm, log = case
    split = Split.parse("first:0.6")
    written = {}
    for name, fits in (("short", True), ("long", False)):
        monkeypatch.setattr(identification, "fits_in_memory", lambda observations, fits=fits: fits)
        result = found(case, split=split, consistent=False)
        assert isinstance(result.blocks, list) is fits
        with RunFolder(tmp_path / name, "identify", {}, {}) as folder:
            write_identification(folder, result, arm.spec, points=30, model=arm, recording=log)
        written[name] = {file.name for file in (tmp_path / name / "figures").glob("*.png")}
        assert (tmp_path / name / "results" / "convergence.csv").exists()
    wanted = {f"{name}.png" for name in ("convergence", "torques", "torques_held_out", "whiteness", "friction")}
    assert written == {"short": wanted, "long": wanted}


def test_convergence_stops_where_data_are_held_out(case):
    result = found(case, split=Split.parse("first:0.6"))
    settling = convergence(result.blocks, result.names, result.estimate.weights, result.transform, every=25)
    assert settling.samples[-1] == result.fit["rows"] // 2  # of two joints; 40 % of the instants are not in it
    np.testing.assert_allclose(settling.x[-1], result.estimate.x, rtol=1e-6, atol=1e-9)
    last = np.diff(settling.x[-3:], axis=0)
    assert np.all(np.any(last != 0.0, axis=1))  # no flat tail
    assert np.all(np.diff(settling.samples) > 0)


def test_units_and_true_values_stand_in_the_panels(case):
    result = found(case)
    settling = convergence(result.blocks, result.names, result.estimate.weights, result.transform, every=100)
    truth = result.estimate.x + 0.1
    figure = plot_convergence(settling, result.estimate.std, result.units, truth)
    for i, axis in enumerate(figure.axes[: len(result.names)]):
        assert axis.get_title().endswith(f"[{result.units[i].replace('^2', '²')}]")
        dashed = [line for line in axis.lines if line.get_linestyle() == "--"]
        assert dashed[0].get_ydata()[0] == truth[i]
        assert axis.get_ylim()[0] <= truth[i] <= axis.get_ylim()[1]


def test_sliding_joints_have_forces():
    assert force_units(rrrgen.load_spec("scara")) == ["N m", "N m", "N", "N m"]


def test_long_recordings_are_thinned_evenly():
    def blocks():
        for start in range(0, 9000, 900):
            t = np.arange(start, start + 900.0)
            yield Rows(t, np.ones((900, 1, 1)), t[:, None], np.ones((900, 1), bool), np.zeros(900, np.int64))

    curves = torque_curves(blocks(), np.array([2.0]), most=1000)
    assert len(curves.t) <= 1000
    steps = np.diff(curves.t)
    assert np.all(steps == steps[0])
    np.testing.assert_array_equal(curves.measured[:, 0], curves.t)
    assert np.all(curves.model == 2.0)


def test_friction_stands_over_speed_with_its_cloud():
    rng = np.random.default_rng(0)
    dq = rng.uniform(-2, 2, (300, 2))
    columns = [Column("m", "rigid"), Column("fv2", "viscous", (0.0, 1.0)), Column("fc2", "coulomb", (0.0, 1.0))]
    W = np.zeros((300, 2, 3))
    W[:, :, 0], W[:, 1, 1], W[:, 1, 2] = rng.normal(size=(300, 2)), dq[:, 1], np.sign(dq[:, 1])
    theta = np.array([3.0, 0.5, 2.0])
    noise = 0.01 * rng.normal(size=(300, 2))
    sample = Sample(dq, dq, dq, W @ theta + noise, np.ones((300, 2), bool), np.arange(300.0), np.zeros(300, np.int64))
    axis = plot_friction(sample, W, columns, theta, ("a", "b"), (True, False)).axes[1]
    cloud, *law = axis.lines
    np.testing.assert_allclose(cloud.get_ydata(), 0.5 * dq[:, 1] + 2.0 * np.sign(dq[:, 1]) + noise[:, 1], atol=1e-12)
    for line in law:
        v = np.asarray(line.get_xdata())
        np.testing.assert_allclose(line.get_ydata(), 0.5 * v + 2.0 * np.sign(v), atol=1e-9)
    assert axis.get_ylabel() == "friction [N]"


def test_curves_on_top_of_each_other_can_be_told_apart():
    matrices = kalman_matrices(1e-3, 1e-11, 1e6)
    lines = plot_bode([matrices] * 3, ["q1", "q2", "q3"]).axes[0].lines[:3]
    assert len({(line.get_linewidth(), str(line.get_linestyle()), line.get_color()) for line in lines}) == 3
    assert lines[0].get_linewidth() > lines[1].get_linewidth() > lines[2].get_linewidth()
