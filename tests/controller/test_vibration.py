"""Input shapers and notch filters: against vibrations simulated in continuous time, published shapers, and as C."""

import json
import subprocess

import numpy as np
import pytest
from scipy.signal import cont2discrete

from emit.c_tools import C99, CXX, SANITIZERS, compile_all, compiler
from rrrgen.base.errors import InputError
from rrrgen.cli.main import run
from rrrgen.lab.response.fitting import aliases
from rrrgen.lab.response.response_model import Resonance
from rrrgen.lab.vibration import KINDS, Vibration, design_notches, design_shaper, impulses, phase_lag

PERIOD = 1e-3
BASE, JOINT = Vibration((28.0,), (0.1,)), Vibration((96.3,), (0.02,))
DRIVER = """#include "vibration_shaper.h"
#include "vibration_notch.h"
#include <stdio.h>

int main(void)
{
    vibration_shaper_state line;
    vibration_notch_real x[4] = {0}, x_next[4], y;
    double u;
    vibration_shaper_start(&line, (vibration_shaper_real)0.5);
    while (scanf("%lf", &u) == 1) {
        int i;
        vibration_notch_step((vibration_notch_real)u, x, &y, x_next);
        for (i = 0; i < 4; i++) x[i] = x_next[i];
        printf("%.17g %.17g\\n", (double)vibration_shaper_step(&line, (vibration_shaper_real)u), (double)y);
    }
    return 0;
}
"""


def left_vibration(shaper, frequency, damping):
    """Amplitude of the free vibration after a shaped step, relative to that after a step: exact in continuous time."""
    w = 2 * np.pi * frequency
    A, B, _, _, _ = cont2discrete(
        (np.array([[0, 1], [-w * w, -2 * damping * w]]), np.array([[0], [w * w]]), np.eye(2), np.zeros((2, 1))), PERIOD
    )

    def amplitude(u):
        x = np.zeros(2)
        for value in u:
            x = A @ x + B[:, 0] * value
        e = x[0] - u[-1]
        return np.hypot(e, (x[1] / w + damping * e) / np.sqrt(1 - damping**2))

    shaped = shaper.run(np.concatenate([[0.0], np.ones(shaper.length + 1)]))
    return amplitude(shaped[1:]) / amplitude(np.ones(1))  # both one sample after their last step


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("mode", [BASE, JOINT, Vibration((1.7,), (0.002,))], ids=["base", "joint", "slow"])
def test_shapers_leave_what_they_promise(kind, mode):
    shaper = design_shaper([mode], PERIOD, kind)
    expected = 0.05 if kind == "ei" else 0.0
    for frequency, damping in zip(mode.frequencies, mode.dampings, strict=True):
        found = left_vibration(shaper, frequency, damping)
        assert found == pytest.approx(shaper.residual(frequency, damping), rel=1e-6, abs=1e-9)
        assert found == pytest.approx(expected, abs=2e-3 if kind == "ei" else 1e-9)
    assert sum(shaper.weights) == pytest.approx(1.0)
    assert min(shaper.weights) > 0.0
    periods = shaper.length * PERIOD * mode.frequency
    assert periods == pytest.approx({"zv": 0.5, "zvd": 1.0, "ei": 1.0}[kind], abs=2.0 * PERIOD * mode.frequency + 0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_a_shaper_stills_every_frequency_that_a_measured_mode_may_stand_for(kind):
    """A mode and its aliases have the same sampled poles, so behind a hold at that rate one design serves them all."""
    shaper = design_shaper([JOINT], PERIOD, kind)
    candidates = aliases(Resonance(96.3, 0.02, 0.1, 0.001), 1.0 / PERIOD)
    assert len(candidates) > 5
    for true in candidates:
        found = left_vibration(shaper, true.frequency, true.damping)
        assert found == pytest.approx(shaper.residual(96.3, 0.02), rel=1e-6, abs=1e-9)
    # at another rate the true frequency matters: a shaper for the alias leaves much of the vibration
    other = design_shaper([JOINT], 1.1 * PERIOD, kind)
    assert other.residual(candidates[1].frequency, candidates[1].damping) > 0.2


def test_ei_is_the_published_one():
    """Fits of third order in the damping by Singhose, Seering and Singer, good to half a per cent."""
    V = 0.05
    for zeta in (0.0, 0.02, 0.05, 0.1, 0.2):
        t, A = impulses("ei", zeta)
        first = 0.24968 + 0.24961 * V + 0.80008 * zeta + 1.23328 * V * zeta + (0.49599 + 3.17316 * V) * zeta**2
        last = 0.25149 + 0.21474 * V - 0.83249 * zeta + 1.41498 * V * zeta + (0.85181 - 4.90094 * V) * zeta**2
        assert A[[0, 2]] == pytest.approx([first, last], abs=2e-3)
        assert A.sum() == pytest.approx(1.0)
        assert t * np.sqrt(1 - zeta**2) == pytest.approx([0.0, 0.5, 1.0], abs=0.012)


def test_ei_is_the_least_sensitive():
    shapers = {kind: design_shaper([Vibration((28.0,), (0.02,))], PERIOD, kind) for kind in KINDS}
    widths = {
        kind: sum(each.residual(f, 0.02) < 0.055 for f in np.linspace(14.0, 42.0, 281)) / 280
        for kind, each in shapers.items()
    }
    assert widths["zv"] == pytest.approx(0.06, abs=0.02)  # of the frequency, 5 % vibration: known as the insensitivity
    assert widths["zvd"] == pytest.approx(0.29, abs=0.03)
    assert widths["ei"] == pytest.approx(0.40, abs=0.04)


def test_postures_decide_between_shapers():
    assert design_shaper([BASE, JOINT], PERIOD).kinds == ("zv", "zv")
    moving = Vibration((26.0, 28.0, 30.0), (0.1, 0.09, 0.1))
    shaper = design_shaper([moving, JOINT], PERIOD)
    assert shaper.kinds == ("ei", "zv")
    assert shaper.worst_residual(moving) < 0.05
    assert max(left_vibration(shaper, f, z) for f, z in zip(moving.frequencies, moving.dampings, strict=True)) < 0.05


@pytest.mark.parametrize("mode", [BASE, JOINT], ids=["base", "joint"])
def test_notch_takes_the_sampled_peak_away(mode):
    (notch,) = design_notches([mode], PERIOD)
    w, zeta = 2 * np.pi * mode.frequency, mode.damping
    _, denominator, _ = cont2discrete(([w * w], [1, 2 * zeta * w, w * w]), PERIOD, method="impulse")
    assert np.array(notch.numerator) / notch.numerator[0] == pytest.approx(denominator, abs=1e-9)
    assert notch.response(np.zeros(1))[0] == pytest.approx(1.0)
    f = np.linspace(0.2 * mode.frequency, 2.0 * mode.frequency, 2000)
    plant = 1.0 / np.abs(1.0 - (f / mode.frequency) ** 2 + 2j * zeta * f / mode.frequency)
    assert np.max(plant * np.abs(notch.response(f))) < 3.6
    assert notch.peak <= 3.0
    wide = design_notches([Vibration((mode.frequency * 0.8, mode.frequency * 1.2), (zeta, zeta))], PERIOD)[0]
    assert wide.width > notch.width
    assert phase_lag([wide], 5.0) > phase_lag([notch], 5.0) > 0.0
    assert design_notches([mode], PERIOD, width=0.7)[0].width == 0.7


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The filters of two modes, in double and float."""
    folder = tmp_path_factory.mktemp("filters")
    modes = ["--mode", "28:0.1", "--mode", "96.3:0.02", "--rate", "1000", "--shaper", "ei"]
    for real in ("double", "float"):
        assert run(["response", "vibration", *modes, "--real", real, "-o", str(folder / real)]) == 0
    return folder


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize(("name", "flags"), [("gcc", [*C99, *SANITIZERS]), ("clang", C99), ("g++", CXX)])
def test_c_equals_python(written, tmp_path, name, flags, real):
    code = tmp_path / "code"
    code.mkdir()
    for file in (written / real / "results").glob("*.[ch]"):
        (code / file.name).write_text(file.read_text())
    (code / "driver.c").write_text(DRIVER)
    program = compile_all(code, [compiler(name), *flags, "-O2", "-ffp-contract=off"])
    u = np.random.default_rng(0).standard_normal(500)
    text = "\n".join(repr(float(value)) for value in u)
    told = subprocess.run([str(program)], input=text, capture_output=True, text=True, timeout=60)
    shaped, filtered = np.array(told.stdout.split(), float).reshape(-1, 2).T
    shaper = design_shaper([BASE, JOINT], PERIOD, "ei")
    reference = shaper.run(np.concatenate([[0.5], u]))[1:]
    size = 1e-13 if real == "double" else 1e-5
    assert np.abs(shaped - reference).max() < size * 4
    reference = u
    for notch in design_notches([BASE, JOINT], PERIOD):
        reference = notch.state_space().run(reference)
    assert np.abs(filtered - reference).max() < size * 4


def test_a_command_that_is_not_finite_counts_as_the_last_one_or_zero(written, tmp_path):
    for file in (written / "double" / "results").glob("*.[ch]"):
        (tmp_path / file.name).write_text(file.read_text())
    driver = DRIVER.replace("&line, (vibration_shaper_real)0.5", "&line, (vibration_shaper_real)NAN")
    (tmp_path / "driver.c").write_text("#include <math.h>\n" + driver)
    program = compile_all(tmp_path, [compiler("gcc"), *C99, "-O1"])
    u = np.random.default_rng(1).standard_normal(40)
    u[[0, 7, 8]] = np.nan, np.inf, -np.inf
    text = "\n".join(repr(float(value)) for value in u)
    done = subprocess.run([str(program)], input=text, capture_output=True, text=True, timeout=60)
    shaped = np.array(done.stdout.split(), float).reshape(-1, 2)[:, 0]
    u[[0, 7, 8]] = 0.0, u[6], u[6]
    reference = design_shaper([BASE, JOINT], PERIOD, "ei").run(np.concatenate([[0.0], u]))[1:]
    assert np.abs(shaped - reference).max() < 1e-12


def test_models_of_postures_lead_to_filters(tmp_path, capsys):
    from rrrgen.lab.response.response_model import ResponseModel

    a = [1.7, -0.9]
    zeros = -np.poly(np.exp(2j * np.pi * 70.0 * PERIOD * np.array([1, -1])) * 0.99).real
    doubtful = Resonance(40.0, 0.2, 2.0, None)  # the recording does not tell whether it exists
    postures = [
        ResponseModel("", np.array(a), np.array([1.0, *-zeros[1:]]), 1, PERIOD, modes, {}, (), name)
        for name, modes in (
            ("up", (doubtful, Resonance(90.0, 0.03, 0.1, 0.001))),
            ("down", (Resonance(97.0, 0.03, 0.1, 0.001),)),
        )
    ]
    record = postures[0].to_json() | {"postures": [each.to_json() for each in postures]}
    text = json.dumps(record, default=lambda value: value.tolist())
    (tmp_path / "model.json").write_text(text)
    model = str(tmp_path / "model.json")
    assert run(["response", "vibration", model, "--crossover", "10", "-o", str(tmp_path / "run")]) == 0
    told = capsys.readouterr().out
    assert "90 to 97 Hz in 2 postures" in told
    assert "40 Hz is left out" in told
    assert "degrees of phase at 10 Hz" in told
    found = json.loads((tmp_path / "run/results/vibration.json").read_text())
    assert found["vibrations"][0]["left"] < 0.05
    assert found["left_out"] == [40.0]
    assert (tmp_path / "run/figures/vibration.png").is_file()
    assert run(["response", "vibration", model, "--against", "antiresonances", "-o", str(tmp_path / "zeros")]) == 0
    assert capsys.readouterr().out.startswith("70.02 Hz")  # of the continuous pole: damped, a little above 70
    # the shaper is told, written, and judged: one that leaves too much ends with 1
    assert run(["response", "vibration", model, "--shaper", "zv", "-o", str(tmp_path / "zv")]) == 1
    assert run(["response", "vibration", model, "--band", "10", "20", "-o", str(tmp_path / "none")]) == 4
    assert "it has 93.5 Hz" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("options", "code", "message"),
    [
        ([], 2, "either MODEL, or --mode and --rate"),
        (["--mode", "28:0.1"], 2, "either MODEL, or --mode and --rate"),
        (["--mode", "28", "--rate", "1000"], 2, "is no mode"),
        (["--mode", "2.8.1:0.1", "--rate", "1000"], 2, "is no mode"),
        (["--mode", "600:0.1", "--rate", "1000"], 3, "above half the sampling rate"),
        (["--mode", "28:0.6", "--rate", "1000"], 3, "dampings from 0 to 0.4"),
        (["--mode", "28:0.1", "--rate", "1000", "--shaper", "none", "--no-notch"], 2, "nothing to design"),
    ],
)
def test_what_cannot_be_designed_is_refused(tmp_path, capsys, options, code, message):
    assert run(["response", "vibration", *options, "-o", str(tmp_path / "run")]) == code
    assert message in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_arguments_without_meaning_are_refused():
    for wrong in (lambda: Vibration((), ()), lambda: Vibration((-1.0,), (0.1,)), lambda: Vibration((1.0,), (1.5,))):
        with pytest.raises(InputError, match="a vibration needs"):
            wrong()
    with pytest.raises(InputError, match="is no shaper"):
        impulses("ZV", 0.1)
    with pytest.raises(InputError, match="needs a vibration"):
        design_shaper([], PERIOD)
    with pytest.raises(InputError, match="width of a notch"):
        design_notches([BASE], PERIOD, width=2.0)


def test_the_phase_lag_of_several_notches_exceeds_half_a_turn():
    """It wrapped to a phase lead; the reference follows the phase of their product up from low frequencies."""
    notches = design_notches([Vibration((f,), (0.02,)) for f in (28.0, 31.0, 34.0)], PERIOD, width=1.0)
    frequencies = np.linspace(0.01, 25.0, 2500)
    z = np.exp(-2j * np.pi * frequencies * PERIOD)
    total = np.prod([np.polyval(n.numerator[::-1], z) / np.polyval(n.denominator[::-1], z) for n in notches], axis=0)
    assert phase_lag(notches, 25.0) == pytest.approx(-np.degrees(np.unwrap(np.angle(total))[-1]), rel=1e-9)
    assert phase_lag(notches, 25.0) > 180.0
    for alias in (500.0, 975.0):
        with pytest.raises(InputError, match=f"a crossover of {alias:.4g} Hz is not below half the sampling rate"):
            phase_lag(notches, alias)


def test_a_file_of_another_kind_is_named_once(tmp_path, capsys):
    other = tmp_path / "other.json"
    other.write_text('{"schema": "other/1"}')
    assert run(["response", "vibration", str(other), "-o", str(tmp_path / "run")]) == 3
    shown = capsys.readouterr().err
    assert shown.count("is no response model") == 1
    assert "InputError" not in shown
