"""One rule for the filters, from the fitted part alone; named settings win; figures say what they were measured on."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from lab.identify.slow_recording import NOISE, TERMS, recording
from rrrgen.base.errors import InputError
from rrrgen.cli.main import cli
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.bandwidth import (
    fitted_stretches,
    largest_bandwidth,
    motion_bandwidth,
    reach,
    speed_spectra,
    stretch_spectra,
    tune,
)
from rrrgen.lab.identify.factoring import factor_recordings
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.lab.identify.observations import Observations, RowMaker
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.lab.identify.scores import score_table
from samples.recordings import fourier_motion, planar_arm, write_log


@pytest.mark.parametrize("rate", [30.0, 100.0, 1000.0])
def test_rows_come_at_ten_times_the_bandwidth_whatever_the_rate_of_the_recording(rate):
    log = recording(rate)
    found = tune(Processing(), [log])
    assert 0.8 < found.motion < 1.4
    assert found.row_rate >= 10 * found.motion
    assert found.row_rate < 2 * 10 * found.motion
    assert found.by_rule == ("decimate", "variances")
    sentence = " ".join(found.sentences())
    assert f"cycle of {found.motion:.3g} Hz" in sentence
    assert f"bandwidth of the motion: {found.motion:.3g} Hz, that of joint " in sentence
    slow = tune(Processing(), [recording(8.0)])
    assert "unfiltered, rows at 8 Hz (every sample stays: the bandwidth" in slow.sentences()[-1]
    assert "tuned by its innovations" in sentence


@pytest.mark.parametrize("split", ["first:0.6", "blocks:2"])
def test_filters_do_not_look_at_held_out_data(split):
    log = recording(200.0)
    chosen = Split.parse(split)
    held_out = ~chosen.is_fitted(log.t, *log.span)
    spoiled = log.q + held_out[:, None] * np.sin(2 * np.pi * 30 * log.t)[:, None]
    other = Log(log.joints, log.t, spoiled, log.tau, period=log.period)
    for processing in (Processing(), Processing("butterworth")):
        assert tune(processing, [other], chosen) == tune(processing, [log], chosen)
        assert tune(processing, [other]) != tune(processing, [log])


@pytest.mark.parametrize("length", [0.4, 1, 4])
def test_blocks_do_not_hide_how_slow_the_motion_is(length):
    """A block of 0.4 s by itself tells no frequency below some Hz; the motion ends at 1 Hz."""
    log = recording(500.0)
    blocks = fitted_stretches(log, Split.parse(f"blocks:{length}"))
    assert {abs(len(stretch.q) - 500 * length) for stretch in blocks[:-1]} <= {0, 1}  # instants at a border
    assert 0.95 < largest_bandwidth(stretch_spectra(blocks, log.period)) < 1.8
    assert 0.95 < motion_bandwidth(log.q, log.period) < 1.1
    with pytest.raises(InputError, match=r"no fitted stretch .*: fit longer parts of the data, or name cutoff and"):
        fitted_stretches(log, Split.parse("blocks:0.1"))


@pytest.mark.parametrize("slope", [0.0, 0.6, 2.0])
def test_the_bandwidth_does_not_follow_noise_of_any_colour(slope):
    """Speeds with noise of a power as f^slope: 2 is that of white positions, drives and filters give less."""
    t = np.arange(0, 60, 1 / 30)
    q, dq, _ = fourier_motion(t, 2, 3, base=0.13)
    rng = np.random.default_rng(1)
    f = np.fft.rfftfreq(len(t), 1 / 30)
    f[0] = f[1]
    noise = np.fft.irfft(np.fft.rfft(rng.normal(size=q.shape), axis=0) * f[:, None] ** (slope / 2 - 1), len(t), axis=0)
    noise *= 0.2 * np.std(dq) / np.std(30 * np.diff(noise, axis=0))
    assert motion_bandwidth(q + noise, 1 / 30) == pytest.approx(0.65, abs=0.05)
    first = speed_spectra(q + noise, 1 / 30)[0]
    assert first.signal == pytest.approx(np.std(dq[:, 0]), rel=0.1)
    assert first.decibels > 20


def test_rounding_errors_of_a_periodic_motion_are_noise_although_they_are_lines():
    t = np.arange(0, 60, 1 / 500)
    q, _, _ = fourier_motion(t, 2, 5, base=0.1)
    for resolution in (1e-4, 1e-3):
        assert motion_bandwidth(np.round(q / resolution) * resolution, 1 / 500) == pytest.approx(0.5, abs=0.07)


@pytest.fixture(scope="module")
def found():
    processing = Processing("butterworth", cutoff=20.0, decimate=20, low_speed=(0.2, 0.2))
    options = Options(terms=TERMS, split=Split.parse("blocks:2"), consistent=False, poses=10, correlated=False)
    return identify(planar_arm(), [recording()], processing, options)


def test_the_score_names_its_rows_its_share_and_its_filter(found):
    log = recording()
    size = float(np.sqrt(np.mean(log.tau**2)))
    where = [(s.data, s.torque, s.rows) for s in found.scores]
    kinds = [("filtered at 20 Hz", "moving"), ("filtered at 20 Hz", "all"), ("unfiltered", "all")]
    assert where == [(data, *kind) for data in ("in sample", "held out") for kind in kinds]
    moving, everything, unfiltered = found.scores[:3]
    assert moving.relative_error == pytest.approx(found.fit["relative_error"], rel=1e-9)
    assert found.scores[3].relative_error == pytest.approx(found.held_out["relative_error"], rel=1e-9)
    assert 0.5 < moving.share < 0.95
    assert moving.count == found.fit["rows"]
    assert everything.share == unfiltered.share == 1.0
    # on every sample: the noise as it is, and where the speed changes sign that of its sign
    assert unfiltered.relative_error == pytest.approx(NOISE / size, rel=0.03)
    assert moving.relative_error < 0.5 * unfiltered.relative_error
    table = score_table(found.scores)
    assert table[1].startswith(
        f"in sample, {100 * moving.share:.0f} % of the rows, slow ones left out, filtered at 20 Hz"
    )
    assert len({len(line) for line in table}) == 1


def test_no_figure_is_shown_twice():
    options = Options(terms=TERMS, consistent=False, poses=10, correlated=False)
    plain = identify(planar_arm(), [recording(100.0)], Processing("butterworth", cutoff=10.0, decimate=1), options)
    assert [(s.data, s.torque, s.rows) for s in plain.scores] == [("in sample", "unfiltered", "all")]


def test_a_guard_band_keeps_either_part_out_of_the_others_rows(found):
    """A step in the torque of the held-out part is felt by fitted rows at its borders, unless these are left out."""
    log, split = recording(noise=0.0), Split.parse("blocks:2")
    assert found.split.guard == reach(found.tuning)
    assert 0.05 < found.split.guard < 0.2  # 20 Hz: some cycles
    held_out = ~split.is_fitted(log.t, *log.span)
    maker = RowMaker(FullRegressor(planar_arm(), TERMS), found.processing, 10)
    stepped = Log(log.joints, log.t, log.q, 0 * log.tau + held_out[:, None], period=log.period)
    rows = list(Observations((stepped,), maker))
    t, tau = (np.concatenate([getattr(part, name) for part in rows]) for name in ("t", "tau"))
    largest = [np.abs(tau[used.is_fitted(t, *log.span)]).max() for used in (split, found.split)]
    assert largest[0] > 0.4
    assert largest[1] < 0.05
    counts = [factor_recordings(Observations((log,), maker), used) for used in (split, found.split)]
    assert np.all(counts[1].fit.counts < counts[0].fit.counts)
    assert np.all(counts[1].score.counts < counts[0].score.counts)
    with pytest.raises(InputError, match="leave nothing between guard bands"):
        Split.parse("blocks:0.1").with_guard(0.06)


def test_guard_bands_lie_at_borders_and_at_no_end():
    t = np.arange(0, 10, 0.01) + 5.0
    split = Split.parse("blocks:2.5").with_guard(0.1)
    between = t[split.between(t, 5.0, 10.0)] - 5.0
    np.testing.assert_allclose([between.min(), between.max()], [2.41, 7.59], atol=0.011)
    parts = np.stack([f(t, 5.0, 10.0) for f in (split.is_fitted, split.is_scored, split.between)])
    assert np.all(parts.sum(axis=0) == 1)
    first = Split.parse("first:0.6").with_guard(0.1)
    assert "0.1 s on either side" in str(first)
    assert np.sum(first.between(t, 5.0, 10.0)) == pytest.approx(20, abs=1)
    assert Split().with_guard(0.1) == Split()


def test_the_command_line_uses_one_rule_and_stores_it(tmp_path):
    """The friction of this log is not in the robot file, which changes nothing here."""
    t = np.arange(4000) / 500.0
    q, dq, ddq = fourier_motion(t, 2, 1)
    tau = rrrgen.compile("planar2r").inverse_dynamics(q, dq, ddq) + 0.5 * np.random.default_rng(1).normal(size=q.shape)
    write_log(tmp_path / "log.csv", Log(("q1", "q2"), t, np.round(q, 5), tau, period=2e-3))

    def run(*arguments):
        found = CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False)
        assert found.return_value == 0, found.output
        return found.output

    text = run("identify", "planar2r", "--log", tmp_path / "log.csv", "--no-consistent", "-o", tmp_path / "found")
    record = json.loads((tmp_path / "found" / "results" / "identification.json").read_text())
    assert "in sample, 100 % of the rows, filtered at" in text
    assert "in sample, 100 % of the rows, unfiltered" in text
    assert "the bandwidth of the motion" in text
    band = record["bandwidth"]
    assert band["chosen_by_rule"] == ["decimate", "variances"]
    assert band["row_rate"] >= 10 * band["motion_bandwidth"]
    filters = [score["torque"] for score in record["scores"]]
    assert filters == [f"filtered at {band['torque_cutoff']:.3g} Hz", "unfiltered"]
    words = ("--cutoff", 20, "--decimate", 10)
    validated = run(
        "experiment", "validate", "planar2r", "--log", tmp_path / "log.csv", *words, "-o", tmp_path / "validated"
    )
    assert "cut-off 20 Hz (as named)" in validated
    assert "a row for 10 samples" in validated
