"""Frequency responses of a flexible joint in closed loop, against the exact discrete truth."""

from dataclasses import replace

import numpy as np
import pytest

from lab.response.periodic import SAMPLES, errors, write
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.cli.main import run
from rrrgen.lab.design.signals import excitation_signal
from rrrgen.lab.response.estimation import estimate_one, find_period
from rrrgen.lab.response.modal_fit import fit_modes
from rrrgen.lab.response.response_file import loads_response, read_recordings
from samples.flexible_joint import PERIOD, flexible_joint, multisine, record


@pytest.mark.parametrize("kind", ["periodic", "noisy"])
def test_local_polynomial_method_meets_its_band(kind, request):
    found = estimate_one(request.getfixturevalue(kind))
    assert ("periodic" if kind == "periodic" else "noise") in found.method
    _, band, held, magnitude, phase = errors(found)
    assert 0.9 < np.mean(held) < 0.985
    narrow = band < 0.05
    assert np.mean(narrow) > 0.4
    assert np.mean((magnitude < 0.04) & (phase < 2.5) & narrow) / np.mean(narrow) > 0.95
    assert found.findings == ()
    assert np.mean(found.trusted[: len(band)]) > 0.75


@pytest.mark.parametrize("method", ["local_polynomial", "instrumental"])
@pytest.mark.parametrize(("kind", "narrow_share"), [("periodic", 0.5), ("noisy", 0.35)])
def test_strong_disturbance_leaves_an_honest_band(kind, narrow_share, method, disturbed):
    """1 rad/s^2 rms of disturbance against 7 of excitation: lines by themselves have bands of 5 %."""
    found = estimate_one(disturbed[kind], method=method)
    _, band, held, magnitude, phase = errors(found)
    assert 0.9 < np.mean(held) < 0.985
    narrow = band < 0.05
    assert np.mean(narrow) > narrow_share
    assert np.mean((magnitude < 0.04) & (phase < 2.5) & narrow) / np.mean(narrow) > 0.95
    assert np.mean(found.trusted[: len(band)]) > 0.8
    wide = found.unsmoothed.band95[: len(band)] > 0.1
    assert np.mean(wide) > 0.1
    assert np.mean(found.trusted[: len(band)][wide]) > 0.7
    assert found.findings == ()


def test_a_joint_that_turns_round_for_a_few_samples_has_a_wider_band():
    """The friction of these samples excites all lines; it repeats with the period, so that no noise shows it."""
    rng = np.random.default_rng(0)
    found = estimate_one(record(rng, multisine(rng, SAMPLES), speed=0.18037, friction=3.0, disturbance=0.7))
    assert found.findings == ()
    _, _, held, _, _ = errors(found)
    assert 0.9 < np.mean(held) < 0.985
    alone = found.unsmoothed
    truth = flexible_joint().response(alone.frequency)
    noise = alone.band95 / np.sqrt(alone.details["scatter_over_noise"])
    assert np.mean(np.abs(alone.P - truth) < noise * np.abs(alone.P)) < 0.88


@pytest.mark.parametrize(("kind", "damping"), [("noisy", 0.02), ("noisy", 0.005), ("periodic", 0.005)])
def test_a_weak_excitation_is_trusted_where_the_response_is_smooth(kind, damping):
    """2 rad/s^2 rms beside .2 of disturbance and encoder steps that exceed the motion of a line above 100 Hz."""
    joint = flexible_joint(((28.0, damping, 0.3), (96.0, damping, 0.5)))
    rng = np.random.default_rng(200)
    n = 2.0 * rng.standard_normal(SAMPLES) if kind == "noisy" else multisine(rng, SAMPLES, rms=2.0)
    found = estimate_one(record(rng, n, joint, disturbance=0.2))
    use = found.frequency < 200.0
    truth, P, band = joint.response(found.frequency[use]), found.P[use], found.band95[use]
    assert 0.9 < np.mean(np.abs(P - truth) < band * np.abs(P)) < 0.985
    assert np.mean(found.trusted[use]) > 0.65
    close = (np.abs(np.abs(P / truth) - 1.0) < 0.04) & (np.abs(np.angle(P / truth, deg=True)) < 2.5)
    assert np.mean(close[band < 0.05]) >= 0.95


@pytest.mark.parametrize("seed", range(2))
def test_windows_are_narrower_at_resonances_where_the_excitation_is_noise(seed):
    """Windows of 4 Hz at resonances less than 1 Hz wide: their bias left .83 to .87 of the bands with the truth."""
    modes = ((9.0, 0.03, 0.2), (31.0, 0.01, 0.3), (58.0, 0.02, 0.2), (83.0, 0.02, 0.4), (127.0, 0.01, 0.2))
    joint, rng = flexible_joint(modes), np.random.default_rng(seed)
    found = estimate_one(record(rng, 7.0 * rng.standard_normal(10000), joint, disturbance=0.2))
    use = found.frequency < 200.0
    truth = joint.response(found.frequency)
    for response in (found, found.unsmoothed):
        assert 0.92 < np.mean((np.abs(response.P - truth) < response.band95 * np.abs(response.P))[use]) < 0.985
    assert np.quantile(np.abs(found.unsmoothed.P / truth - 1.0)[use], 0.9) < 0.07  # .08 to .09 with wide windows alone


def test_leakage_beside_the_band_of_noise_is_no_excitation():
    rng = np.random.default_rng(14)
    X = np.fft.rfft(rng.standard_normal(24000))
    X[np.fft.rfftfreq(24000, PERIOD) > 150.0] = 0.0
    n = np.fft.irfft(X)
    whole = record(rng, 10.0 * n)
    cut = type(whole)("cut", PERIOD, whole.n[3000:23000], whole.u[3000:23000], whole.q[3000:23000])
    found = estimate_one(cut)
    assert found.frequency[-1] < 152.0
    assert found.frequency[found.trusted][-1] < 150.5
    _, _, held, _, _ = errors(found, 150.0)
    assert 0.9 < np.mean(held) < 0.985
    model = fit_modes(found)
    assert [mode.frequency for mode in model.resonances] == pytest.approx([28.0, 96.0], rel=5e-3)


def test_resonances_are_not_smoothed_away():
    rng = np.random.default_rng(12)
    joint = flexible_joint(((28.0, 0.003, 0.3), (96.0, 0.004, 0.5)))
    found = estimate_one(record(rng, multisine(rng, SAMPLES), joint, disturbance=1.0))
    near = np.abs(found.frequency - 28.0) <= 1.0
    assert np.all(np.array(found.details["smoothed_over"])[near] == 1)
    truth = joint.response(found.frequency)
    close = np.abs(found.frequency - 28.0) < 6.0
    assert np.mean((np.abs(found.P - truth) < found.band95 * np.abs(found.P))[close]) > 0.85


def test_a_ratio_to_no_noise_at_all_is_not_printed_as_a_number():
    """Without noise the ratio is one to round-off, 1e20: its digits mean nothing."""
    rng = np.random.default_rng(4)
    quiet = record(rng, multisine(rng, SAMPLES), speed=0.5, resolution=2e-4, disturbance=0.0)
    period = find_period(quiet.n)
    same = {name: np.resize(getattr(quiet, name)[:period], len(quiet.q)) for name in ("n", "u", "q")}
    found = estimate_one(replace(quiet, **same))  # every period the same to the last bit
    assert found.findings[0].measure > 1e6
    assert "more than 1000 times as much as its noise" in found.findings[0].message


@pytest.mark.parametrize(
    ("samples", "extra", "message"),
    [
        (3000, "period: 2 s\n", "1.50 periods"),
        (3000, "", "1.50 periods"),
        (2000, "", "1.00 periods"),
        (200, "", "too few"),
        (4000, "period: 1.0005 s\n", "not a whole number of samples"),
        (4000, "period: 1.5 s\n", "does not repeat"),
    ],
)
def test_too_little_data_is_refused(periodic, tmp_path, capsys, samples, extra, message):
    part = type(periodic)("cut", PERIOD, periodic.n[:samples], periodic.u[:samples], periodic.q[:samples])
    assert run(["response", "frf", str(write(tmp_path, part, extra)), "-o", str(tmp_path / "run")]) == 4
    assert message in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("column", ["n", "u", "q"])
def test_nothing_excited_is_refused(periodic, column):
    columns = {"n": periodic.n, "u": periodic.u, "q": periodic.q} | {column: np.zeros(SAMPLES)}
    with pytest.raises(DerivationError, match="is constant"):
        estimate_one(type(periodic)("still", PERIOD, **columns))


@pytest.mark.parametrize(
    ("old", "new", "place", "message"),
    [
        ("output:", "outptu:", ":6:1", "unknown key 'outptu'"),
        ("{column: 2}", "{colum: 2}", ":5:9", "unknown key 'colum'"),
        ("rate: 1 kHz", "rate: -1 kHz", ":3:14", "must be positive"),
        ("{column: 3, unit: rad}", "{column: 7}", "log.npy", "column '7'|column 7"),
        ("log.npy", "log2.npy", "log2.npy", "no such file"),
    ],
)
def test_faults_of_the_response_file_have_a_place(periodic, tmp_path, old, new, place, message):
    text = write(tmp_path, periodic).read_text().replace(old, new)
    with pytest.raises(InputError, match=message) as caught:
        read_recordings(loads_response(text, str(tmp_path / "response.yaml")))
    assert place in str(caught.value)


def test_gaps_and_missing_numbers_are_refused(periodic, tmp_path):
    log = write(tmp_path, periodic)
    rows = np.column_stack([periodic.n, periodic.u, periodic.q])
    rows[41, 1] = np.nan
    np.save(tmp_path / "log.npy", rows)
    with pytest.raises(InputError, match="column '2' has no number in row 42"):
        read_recordings(loads_response(log.read_text(), str(log)))
    t = PERIOD * np.arange(SAMPLES)
    t[500:] += 0.01
    np.save(tmp_path / "log.npy", np.column_stack([rows[:, 0], t, periodic.q]))
    with pytest.raises(InputError, match="not on a grid"):
        read_recordings(loads_response(log.read_text().replace("rate: 1 kHz", "column: 2"), str(log)))


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_cut_from_noise_in_a_band_is_no_single_period(seed):
    """What its ends leak beyond the band is smooth over the lines, as the lines of one multisine are."""
    noise = excitation_signal("noise", (0.5, 200.0), 3 * SAMPLES, 1.0 / PERIOD, np.random.default_rng(seed))
    assert find_period(noise[4000 : 4000 + SAMPLES]) is None


def test_beyond_the_band_of_the_excitation_there_are_no_lines():
    """What the ends of the record leak there is as smooth as the transient: the response could not be told."""
    rng = np.random.default_rng(1)
    n = 7.0 * excitation_signal("noise", (0.5, 120.0), 3 * SAMPLES, 1.0 / PERIOD, rng)[:SAMPLES]
    found = estimate_one(record(rng, n))
    assert found.frequency.max() < 122.0
    wrong, band, held, _, _ = errors(found, 500.0)
    assert np.mean(held) > 0.9
    assert wrong[band < 0.05].max() < 0.2
