"""Recordings that would lead to a wrong response within a narrow band: refused, or not trusted, with the reason."""

from dataclasses import replace

import numpy as np
import pytest

from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.response.estimation import estimate_one
from rrrgen.lab.response.response_file import ResponseRecording, loads_response, read_recordings
from rrrgen.lab.response.response_model import ControllerTransferFunction
from samples.flexible_joint import CONTROLLER, KD, KP, PERIOD, flexible_joint, multisine, record

SAMPLES = 10000


def noise(seed):
    return 7.0 * np.random.default_rng(seed).standard_normal(SAMPLES)


@pytest.fixture(scope="module")
def good():
    return record(np.random.default_rng(21), noise(20))


@pytest.mark.parametrize("limit", [15.0, 9.0])
def test_an_input_behind_a_limit_of_torque_is_refused(good, limit):
    """The response is too small at all lines alike, so that neither bands nor scatter tell it."""
    found = estimate_one(record(np.random.default_rng(21), noise(20), limit=limit))
    assert [finding.kind for finding in found.findings] == ["limit"]
    assert "limit of torque" in found.findings[0].message
    assert estimate_one(good).findings == ()


def test_a_limit_that_a_multisine_reaches_is_refused():
    rng = np.random.default_rng(23)
    found = estimate_one(record(rng, multisine(rng, SAMPLES), limit=9.0))
    assert [finding.kind for finding in found.findings] == ["distortion"]


@pytest.mark.parametrize("disturbance", [1.0, 5.0])
def test_strong_disturbances_are_no_limit(disturbance):
    """They are in the input too, through the controller."""
    rng = np.random.default_rng(24)
    assert estimate_one(record(rng, noise(124), disturbance=disturbance)).findings == ()
    uniform = 7.0 * rng.uniform(-1.7, 1.7, SAMPLES)
    assert estimate_one(record(rng, uniform, disturbance=disturbance)).findings == ()


@pytest.mark.parametrize("kind", ["noise", "multisine"])
def test_a_controller_that_is_not_the_recorded_one_is_refused(good, kind):
    rng = np.random.default_rng(22)
    recorded = good if kind == "noise" else record(rng, multisine(rng, SAMPLES))
    assert estimate_one(recorded, controller=CONTROLLER, method="indirect").findings == ()
    half = ControllerTransferFunction(tuple(0.5 * c for c in CONTROLLER.numerator))
    opposite = ControllerTransferFunction(tuple(-c for c in CONTROLLER.numerator))
    continuous = ControllerTransferFunction((KP + KD, -KD))  # without the sampling period
    nearly = ControllerTransferFunction(tuple(1.03 * c for c in CONTROLLER.numerator))
    for wrong in (half, opposite, continuous, nearly):
        found = estimate_one(recorded, controller=wrong, method="indirect")
        assert [finding.kind for finding in found.findings] == ["controller"]
        assert not found.trusted.any()


def test_an_excitation_that_does_not_reach_the_input_is_refused():
    """Input and output follow noise alone; their ratio is that of the controller, at all lines alike."""
    rng = np.random.default_rng(25)
    still = record(rng, np.zeros(SAMPLES))
    with pytest.raises(DerivationError, match=r"shows in the input at \d+ % of the lines"):
        estimate_one(replace(still, n=1e-9 * rng.standard_normal(SAMPLES)))


def test_lines_at_which_the_excitation_hardly_shows_are_not_trusted():
    rng = np.random.default_rng(26)
    found = estimate_one(record(rng, 2e-3 * noise(126)))
    truth = flexible_joint().response(found.frequency)
    assert not np.any((np.abs(found.P / truth - 1.0) > 0.5) & found.trusted)


def test_bands_that_are_no_number_are_not_trusted(good):
    found = estimate_one(good)
    band = found.band95.copy()
    band[10] = np.nan
    assert not replace(found, band95=band).trusted[10]


def response_file(folder, rows, excitation=2, given=3, output=4, time="{column: 1}"):
    np.save(folder / "log.npy", rows)
    text = (
        f"schema: rrrgen-response/1\nfiles: log.npy\ntime: {time}\nexcitation: {excitation}\ninput: {given}\n"
        f"output: {output}\n"
    )
    return loads_response(text, str(folder / "response.yaml"))


@pytest.fixture
def rows(good: ResponseRecording):
    return np.column_stack([PERIOD * np.arange(SAMPLES), good.n, good.u, good.q])


@pytest.mark.parametrize(
    ("columns", "place"), [((2, 4, 4), ":5:8: .*input and"), ((4, 3, 4), ":4:13: .*excitation and")]
)
def test_an_output_that_is_also_something_else_is_refused(rows, tmp_path, columns, place):
    with pytest.raises(InputError, match=f"{place} output are the same column"):
        response_file(tmp_path, rows, *columns)
    assert (
        len(read_recordings(response_file(tmp_path, rows, 3, 3, 4))) == 1
    )  # an open loop: its input is its excitation


@pytest.mark.parametrize("order", ["backwards", "constant", "a step back"])
def test_instants_that_do_not_increase_are_refused(rows, tmp_path, order):
    if order == "a step back":
        rows[700, 0] = rows[698, 0]
    else:
        rows[:, 0] = rows[::-1, 0] if order == "backwards" else 3.0
    row = 701 if order == "a step back" else 2
    with pytest.raises(InputError, match=f"times do not increase in row {row}\n"):
        read_recordings(response_file(tmp_path, rows))


def test_inexact_instants_lead_to_the_rate(rows, tmp_path):
    rows[:, 0] += 0.1 * PERIOD * np.random.default_rng(27).uniform(-1.0, 1.0, SAMPLES)
    with pytest.raises(InputError, match=r"time: \{rate"):
        read_recordings(response_file(tmp_path, rows))
    (found,) = read_recordings(response_file(tmp_path, rows, time="{rate: 1 kHz}"))
    assert estimate_one(found).findings == ()


@pytest.mark.parametrize(
    ("modes", "top"), [(((16.7, 0.004, 0.4),), 33.0), (((14.5, 0.02, 0.4), (27.6, 0.003, 0.5)), 55.0)]
)
def test_a_resonance_among_few_lines_is_no_distortion(modes, top):
    """A sharp resonance bends the response over a dozen lines, here a fifth of all."""
    rng = np.random.default_rng(28)
    n = multisine(rng, SAMPLES, band=(0.5, top))
    found = estimate_one(record(rng, n, flexible_joint(modes), speed=0.4917331, disturbance=0.3))
    assert found.findings == ()
    rough = estimate_one(record(rng, n, flexible_joint(modes), speed=0.05, friction=2.0, disturbance=0.3))
    assert [finding.kind for finding in rough.findings][:1] == ["distortion"]


def test_instants_in_milliseconds_need_their_unit(rows, tmp_path):
    """Read as seconds they would lead to resonances a thousand times too low."""
    rows[:, 0] *= 1e3
    with pytest.raises(InputError, match=r"log.npy: .*the times are 1 apart, which would be seconds: state their unit"):
        read_recordings(response_file(tmp_path, rows))
    (found,) = read_recordings(response_file(tmp_path, rows, time="{column: 1, unit: ms}"))
    assert found.period == pytest.approx(PERIOD)
    (slow,) = read_recordings(response_file(tmp_path, rows, time="{column: 1, unit: s}"))
    assert slow.period == pytest.approx(1.0)


def test_messages_name_the_recording_by_its_file(rows, tmp_path):
    (found,) = read_recordings(response_file(tmp_path, rows[:40]))
    with pytest.raises(DerivationError, match=r"^log: 40 samples are too few"):
        estimate_one(found)
    np.save(tmp_path / "shoulder.npy", rows[:40])
    text = "schema: rrrgen-response/1\nfiles: shoulder.npy\ntime: {rate: 1 kHz}\ninput: 3\noutput: 4\n"
    (found,) = read_recordings(loads_response(text, str(tmp_path / "response.yaml")))
    with pytest.raises(DerivationError, match=r"^shoulder: 40 samples are too few"):
        estimate_one(found)


@pytest.mark.parametrize(
    ("row", "message"), [("0.029,1.5", "2 entries, where 3 are needed"), ("1;2;3", "where 2 are needed")]
)
def test_a_line_that_differs_near_the_start_is_named(tmp_path, row, message):
    lines = ["t,u,q", *(f"{1e-3 * k:.3f},{k % 7},{k % 5}" for k in range(200))]
    lines[30] = row
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    text = "schema: rrrgen-response/1\nfiles: log.csv\ntime: {rate: 1 kHz}\ninput: u\noutput: q\n"
    with pytest.raises(InputError, match=f"log.csv:31:1: error: .*{message}"):
        read_recordings(loads_response(text, str(tmp_path / "response.yaml")))
