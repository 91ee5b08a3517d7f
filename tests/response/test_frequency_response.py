"""Frequency responses of a flexible joint in closed loop, against the exact discrete truth."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from rrrgen.base.errors import DerivationError, InputError
from rrrgen.cli.main import cli, run
from rrrgen.lab.design.signals import excitation_signal
from rrrgen.lab.response.estimation import combine, estimate_one, find_period
from rrrgen.lab.response.frequency_response import read_responses
from rrrgen.lab.response.modal_fit import fit_modes
from rrrgen.lab.response.response_file import loads_response, read_recordings
from samples.flexible_joint import CONTROLLER, PERIOD, flexible_joint, multisine, record

SAMPLES = 20000  # 20 s


@pytest.fixture(scope="module")
def periodic():
    rng = np.random.default_rng(1)
    return record(rng, multisine(rng, SAMPLES))


@pytest.fixture(scope="module")
def noisy():
    rng = np.random.default_rng(2)
    return record(rng, 7.0 * rng.standard_normal(SAMPLES))


@pytest.fixture(scope="module")
def disturbed():
    """With 1 rad/s^2 rms of disturbance, which both methods are tested with."""
    found = {}
    for kind in ("periodic", "noisy"):
        rng = np.random.default_rng(11)
        n = multisine(rng, SAMPLES) if kind == "periodic" else 7.0 * rng.standard_normal(SAMPLES)
        found[kind] = record(rng, n, disturbance=1.0)
    return found


def errors(found, highest=200.0):
    """Relative complex error, band and whether it holds the truth, magnitude and phase error, of lines below
    ``highest``.
    """
    use = found.frequency < highest
    truth, P = flexible_joint().response(found.frequency[use]), found.P[use]
    held = np.abs(P - truth) < found.band95[use] * np.abs(P)
    ratio = P / truth
    return np.abs(ratio - 1), found.band95[use], held, np.abs(np.abs(ratio) - 1), np.abs(np.angle(ratio, deg=True))


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


def test_indirect_method_needs_the_controller_as_implemented(periodic):
    found = estimate_one(periodic, controller=CONTROLLER, method="indirect")
    wrong, _, held, _, _ = errors(found)
    low = found.frequency[: len(wrong)] < 8.0
    assert np.median(wrong[low]) < 0.02  # beyond the bandwidth S tends to 1, and 1/S - 1 to noise
    assert 0.85 < np.mean(held) < 0.99
    with pytest.raises(InputError, match="needs the controller"):
        estimate_one(periodic, method="indirect")


@pytest.mark.parametrize("kind", ["periodic", "noisy"])
def test_instrumental_estimate_is_unbiased_where_the_direct_one_is_not(kind, request):
    rng = np.random.default_rng(5)
    n = multisine(rng, SAMPLES) if kind == "periodic" else 7.0 * rng.standard_normal(SAMPLES)
    disturbed = record(rng, n, disturbance=20.0)
    medians = {}
    for method in ("instrumental", "direct"):
        found = estimate_one(disturbed, method=method)
        use = found.frequency < 3.0
        medians[method] = np.median(np.abs(found.P / flexible_joint().response(found.frequency) - 1)[use])
    assert medians["direct"] > 1.2 * medians["instrumental"]
    good = estimate_one(request.getfixturevalue(kind), method="instrumental")
    assert np.median(errors(good)[0]) < 0.05


def test_a_sweep_that_is_not_repeated_cannot_be_averaged():
    """Each line is excited in one window or two, and what rings on in the next had errors of sixty times the band."""
    t = PERIOD * np.arange(SAMPLES)
    swept = record(np.random.default_rng(0), 7.0 * np.sin(2.0 * np.pi * (0.5 * t + 150.0 / 40.0 * t**2)))
    for method in ("instrumental", "direct"):
        with pytest.raises(DerivationError, match="moves through its band"):
            estimate_one(swept, method=method)
    wrong, band, _, _, _ = errors(estimate_one(swept), 140.0)
    assert np.max(wrong / band) < 2.0


def test_a_sine_is_averaged_at_its_own_line_alone():
    """Its trend in a window is no drift; without it, harmonics appeared at which there is no excitation."""
    sine = 7.0 * np.sin(2.0 * np.pi * 5.0 * PERIOD * np.arange(SAMPLES))
    found = estimate_one(record(np.random.default_rng(0), sine), method="instrumental")
    assert found.frequency == pytest.approx([5.0])


@pytest.mark.parametrize("kind", ["periodic", "noisy", "odd"])
def test_friction_at_changes_of_direction_is_refused(kind):
    rng = np.random.default_rng(3)
    n = 7.0 * rng.standard_normal(SAMPLES) if kind == "noisy" else multisine(rng, SAMPLES, odd=kind == "odd")
    good = estimate_one(record(rng, n, speed=0.05, friction=0.0))
    assert good.findings == ()
    bad = estimate_one(record(rng, n, speed=0.05, friction=1.0))
    assert {finding.kind for finding in bad.findings} <= {"friction", "distortion"}
    assert bad.findings
    assert not bad.trusted.any()


@pytest.mark.parametrize(("speed", "friction"), [(0.02, 1.0), (0.12, 3.0)])
def test_friction_is_seen_beside_noise_in_a_band(speed, friction):
    """Leakage from the ends of this recording hid the friction beside the band; in the second few samples go back."""
    rng = np.random.default_rng(0)
    n = 7.0 * excitation_signal("noise", (0.5, 220.0), 30000, 1.0 / PERIOD, rng)[5000:25000]
    found = estimate_one(record(rng, n, speed=speed, friction=friction))
    assert [finding.kind for finding in found.findings] == ["friction"]


@pytest.mark.parametrize("kind", ["periodic", "noisy"])
def test_a_joint_that_turns_round_is_refused_where_it_has_friction(kind):
    rng = np.random.default_rng(13)
    n = 7.0 * rng.standard_normal(SAMPLES) if kind == "noisy" else multisine(rng, SAMPLES)
    turning = {"speed": 1.2, "turn_after": 3.7}
    bad = estimate_one(record(rng, n, friction=1.0, **turning))
    assert [finding.kind for finding in bad.findings] == ["friction"]
    assert "changes sign" in bad.findings[0].message
    assert estimate_one(record(rng, n, **turning)).findings == ()


def test_fast_joint_with_the_same_friction_is_trusted():
    rng = np.random.default_rng(3)
    assert estimate_one(record(rng, multisine(rng, SAMPLES), speed=1.0237, friction=1.0)).findings == ()


def test_quantisation_that_repeats_every_period_is_refused():
    rng = np.random.default_rng(4)
    n = multisine(rng, SAMPLES)
    repeating = estimate_one(record(rng, n, speed=0.5, resolution=2e-4, disturbance=0.0))
    assert [finding.kind for finding in repeating.findings] == ["distortion"]
    assert not repeating.trusted.any()
    # at a speed that is no multiple of resolution/period the error averages out, and the band says what is left of it
    assert estimate_one(record(rng, n, speed=0.51237, resolution=2e-4, disturbance=0.0)).findings == ()


def test_realisations_tell_noise_from_distortion():
    rng = np.random.default_rng(6)
    linear = [estimate_one(record(rng, multisine(rng, 8000), disturbance=1.0)) for _ in range(4)]
    mean = combine(linear, "mean")
    assert mean.details["distortion"]["total_over_noise_variance"] < 1.5
    assert mean.findings == ()
    assert np.median(mean.unsmoothed.band95) < 0.6 * np.median(linear[0].unsmoothed.band95)
    assert np.median(mean.band95) < np.median(linear[0].band95)
    rough = [estimate_one(record(rng, multisine(rng, 8000), speed=0.05, friction=2.0)) for _ in range(3)]
    assert combine(rough, "mean").findings[0].kind == "distortion"


def test_a_ratio_to_no_noise_at_all_is_not_printed_as_a_number():
    """Without noise the ratio is one to round-off, 1e20: its digits mean nothing."""
    rng = np.random.default_rng(4)
    quiet = record(rng, multisine(rng, SAMPLES), speed=0.5, resolution=2e-4, disturbance=0.0)
    period = find_period(quiet.n)
    same = {name: np.resize(getattr(quiet, name)[:period], len(quiet.q)) for name in ("n", "u", "q")}
    found = estimate_one(replace(quiet, **same))  # every period the same to the last bit
    assert found.findings[0].measure > 1e6
    assert "more than 1000 times as much as its noise" in found.findings[0].message


def write(folder, recording, extra="", columns=("1", "2", "3")):
    np.save(folder / "log.npy", np.column_stack([recording.n, recording.u, recording.q]))
    n, u, q = columns
    (folder / "response.yaml").write_text(
        "schema: rrrgen-response/1\nfiles: log.npy\ntime: {rate: 1 kHz}\n"
        f"excitation: {{column: {n}}}\ninput: {{column: {u}}}\noutput: {{column: {q}, unit: rad}}\n{extra}"
    )
    return folder / "response.yaml"


def test_command_writes_the_response_and_its_figure(periodic, tmp_path):
    log = write(tmp_path, periodic)
    told = CliRunner().invoke(cli, ["response", "frf", str(log), "-o", str(tmp_path / "run")], standalone_mode=False)
    assert told.return_value == 0, told.output
    assert "trusted" in told.output
    found = json.loads((tmp_path / "run/results/frf.json").read_text())
    lengths = {len(found[key]) for key in ("frequency", "re", "im", "band95", "coherence", "trusted")}
    assert lengths == {400}
    assert found["method"].startswith("local_polynomial")
    assert np.allclose(np.array(found["frequency"]), 0.5 + 0.5 * np.arange(400))
    assert (tmp_path / "run/figures/frf.png").is_file()
    (again,) = read_responses(tmp_path / "run/results/frf.json")
    assert np.allclose(again.P, np.array(found["re"]) + 1j * np.array(found["im"]))
    assert np.allclose(again.unsmoothed.variance, found["unsmoothed"]["variance"])


@pytest.mark.usefixtures("no_figures")
def test_postures_stand_beside_one_another(periodic, noisy, tmp_path):
    for name, each in (("left", periodic), ("right", noisy)):
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack([PERIOD * np.arange(SAMPLES), each.n, each.u, each.q]))
    text = (
        "schema: rrrgen-response/1\nfiles: [left.csv, right.csv]\ntime: {column: 1}\nexcitation: {column: 2}\n"
        "input: 3\noutput: 4\nrecordings: postures\n"
    )
    (tmp_path / "response.yaml").write_text(text)
    assert run(["response", "frf", str(tmp_path / "response.yaml"), "-o", str(tmp_path / "run")]) == 0
    found = json.loads((tmp_path / "run/results/frf.json").read_text())
    assert [each["name"] for each in found["postures"]] == ["left", "right"]


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
