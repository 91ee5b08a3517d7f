"""The mapping file: what it says is what is meant, and every fault is reported at once, in its place."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.lab.data.mapping import load_mapping, loads_mapping
from rrrgen.lab.data.recordings import check_robot, open_log
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.robot.file import load_spec

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"

FAULTY = """\
schema: rrrgen-log/2
files: {a: x.csv, b: {pth: y.csv, format: cvs}}
time: {rate: 1 kH, period: 1}
units: {position: grad, torque: A}
joints:
  - {name: j1, position: {column: q1}, torque: {file: a, column: t1}}
  - {name: j1, position: {file: c, column: q2, sign: 2}, gear_ratio: 0}
transmission: {matrix: [[1, 2], [2, 4]]}
coupled_drives: [{name: x, direction: [1]}]
processing: {cutof: 3, method: buterworth}
extra: 1
"""


def test_every_fault_is_reported_at_once_in_its_place():
    with pytest.raises(InputError) as caught:
        loads_mapping(FAULTY, "log.yaml")
    found = {(fault.line, fault.message) for fault in caught.value.faults}
    expected = [
        (1, "schema is 'rrrgen-log/2'"),
        (2, "files.b needs the key 'path'"),
        (2, "unknown key 'pth' in files.b"),
        (2, "format is 'cvs'"),
        (3, "time needs exactly one of rate, period and column"),
        (4, "units.position has the unit 'grad'"),
        (6, "joints[0].position has no unit"),
        (6, "joints[0].position needs the key 'file'"),
        (6, "joints[0].torque in A needs the key 'constant'"),
        (7, "a second joint 'j1'"),
        (7, "joints[1].position.file is 'c'"),
        (7, "joints[1].position.sign is not +1 or -1"),
        (7, "a gear ratio of zero"),
        (8, "both a transmission matrix and gear ratios"),
        (8, "the transmission matrix is singular"),
        (9, "unknown key 'coupled_drives' in the mapping file"),
        (10, "unknown key 'cutof' in processing"),
        (10, "processing.method is 'buterworth'"),
        (11, "unknown key 'extra' in the mapping file"),
    ]
    assert [entry for entry in expected if entry not in found] == []
    hints = "\n".join(str(fault) for fault in caught.value.faults)
    for suggestion in ("did you mean 'path'?", "did you mean 'csv'?", "did you mean 'rad'?", "did you mean 'cutoff'?"):
        assert suggestion in hints


@pytest.mark.parametrize(
    "text",
    ["", "- a", "schema: rrrgen-log/1", "{", "schema: rrrgen-log/1\nfiles: []\ntime: 3\njoints: 5\n", "a: &b [*b]"],
)
def test_whatever_is_no_mapping_is_an_input_error(text):
    with pytest.raises(InputError):
        loads_mapping(text)


def test_a_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="cannot read"):
        load_mapping(tmp_path / "none.yaml")


def test_the_tx40_example():
    mapping = load_mapping(EXAMPLES / "tx40" / "log.yaml")
    assert mapping.n == 6
    assert mapping.time.period == pytest.approx(2e-4)
    N = mapping.transmission
    np.testing.assert_array_equal(np.diag(N), [32, 32, 45, -48, 45, 32])
    assert N[5, 4] == 32
    tau_motor = np.arange(1.0, 7.0)[None]
    # tau_5 = 45 y_5 + 32 y_6: the last motor also turns joint 5
    assert mapping.joint_side("torque", tau_motor)[0, 4] == 45 * 5 + 32 * 6
    q_motor = np.array([[32.0, 32.0, 45.0, -48.0, 45.0, 64.0]])
    np.testing.assert_allclose(mapping.joint_side("position", q_motor)[0], [1, 1 - np.pi / 2, 1 + np.pi / 2, 1, 1, 1])


def test_units_are_read_in_their_many_spellings():
    for spelling in ("N*m", "Nm", "N m", "N·m"):
        text = f"""
schema: rrrgen-log/1
files: a.csv
time: {{column: t, unit: µs}}
joints: [{{name: a, position: {{column: q, unit: °}}, torque: {{column: u, unit: "{spelling}"}}}}]
"""
        mapping = loads_mapping(text)
        assert mapping.joints[0].torque.factor == 1.0
        assert mapping.joints[0].position.factor == pytest.approx(np.pi / 180)
        assert mapping.time.factor == 1e-6


def test_a_transmission_that_is_not_the_robots_is_refused():
    """Motors may be counted in other gears and signs, but they turn with the joints that the robot file names."""
    mapping = load_mapping(EXAMPLES / "tx40" / "log.yaml")
    spec = load_spec(EXAMPLES / "tx40" / "robot.yaml")
    check_robot(mapping, spec)
    check_robot(replace(mapping, transmission=-2.0 * mapping.transmission), spec)
    uncoupled = replace(mapping, transmission=np.diag(np.diag(mapping.transmission)))
    with pytest.raises(
        InputError, match="motor m6 turns with joint_6 by the transmission, with joint_5 and joint_6 by"
    ):
        check_robot(uncoupled, spec)
    check_robot(uncoupled, replace(spec, drives=None))


def test_one_file_with_its_separator_and_references_in_the_unit_of_positions():
    text = FAULTY.splitlines()[0].replace("/2", "/1") + '\nfiles: {path: x.csv, separator: ";"}\ntime: {period: 1 ms}\n'
    text += "units: {position: deg, torque: N*m}\njoints:\n"
    text += "  - {name: j1, position: q1, torque: t1, reference: r1, feedforward: f1}\n"
    mapping = loads_mapping(text, "log.yaml")
    assert [(file.path.name, file.separator) for file in mapping.files] == [("x.csv", ";")]
    channel = mapping.joints[0]
    assert channel.reference.factor == channel.position.factor
    assert channel.feedforward.factor == channel.torque.factor


GAINS = """
schema: rrrgen-log/1
files: log.csv
time: {rate: 100 Hz}
units: {position: rad, torque: N*m}
joints:
  - {name: a, position: q_a, torque: {column: tau_a, gain: 0.5, delay: 30 ms}}
  - {name: b, position: q_b, torque: tau_b}
"""


def test_a_torque_constant_and_a_delay_are_corrected_by_the_mapping(tmp_path):
    (tmp_path / "log.yaml").write_text(GAINS)
    t = np.arange(200) / 100.0
    tau = np.column_stack([np.sin(t), np.cos(t)])
    recorded = np.column_stack([2.0 * np.sin(t - 0.03), tau[:, 1]])
    table = np.column_stack([t, t, recorded])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="q_a,q_b,tau_a,tau_b", comments="")
    (part,) = LogStream(open_log(tmp_path / "log.yaml")).parts()
    aligned = part.align_torques()
    inside = aligned.valid.all(axis=1)
    assert inside.sum() == len(t) - 3
    np.testing.assert_allclose(aligned.tau[inside], tau[inside], atol=1e-12)
    faulty = GAINS.replace("gain: 0.5", "gain: -1").replace("position: q_b", "position: {column: q_b, delay: 1 ms}")
    with pytest.raises(InputError) as caught:
        loads_mapping(faulty)
    messages = [fault.message for fault in caught.value.faults]
    assert messages == [
        "joints[0].torque.gain is -1, not positive",
        "joints[1].position has a delay, which only a torque has",
    ]


IDLE = """\
schema: rrrgen-log/1
files: log.csv
time: {rate: 100 Hz}
units: {position: rad, torque: N*m, velocity: rad/s}
joints:
  - name: a
    zero: ZERO
    MORE
    position: {column: 1, POSITION}
    velocity: {column: 2, VELOCITY}
    torque: {column: 3, TORQUE}
GAP
"""
PLACES = {"ZERO": 7, "MORE": 8, "POSITION": 9, "VELOCITY": 10, "TORQUE": 11, "GAP": 12}


def described(**parts):
    text = IDLE
    for place in PLACES:
        usual = {"ZERO": "0", "MORE": "", "GAP": ""}.get(place, "sign: 1")
        text = text.replace(place, parts.get(place, usual))
    return text


@pytest.mark.parametrize(
    ("place", "text", "at", "message"),
    [
        ("POSITION", "unit: counts, counts_per_turn: 0", ": 0", "joints[0].position.counts_per_turn is zero"),
        ("POSITION", "unit: counts, resolution: 0 deg", ": 0", "joints[0].position.resolution is zero"),
        (
            *("POSITION", "unit: counts, counts_per_turn: 4096, resolution: 0.1 deg", ": 0.1"),
            "joints[0].position has both counts_per_turn and resolution",
        ),
        (
            "POSITION",
            "unit: deg, resolution: 2",
            ": 2",
            "joints[0].position.resolution has no effect on a column in deg",
        ),
        (
            "POSITION",
            "counts_per_turn: 9",
            ": 9",
            "joints[0].position.counts_per_turn has no effect on a column in rad",
        ),
        ("POSITION", "constant: 9", ": 9", "joints[0].position.constant has no effect on a column in rad"),
        ("VELOCITY", "resolution: 9", ": 9", "joints[0].velocity.resolution has no effect on a column in rad/s"),
        ("TORQUE", "constant: 0.1 N*m/A", ": 0.1", "joints[0].torque.constant has no effect on a column in N*m"),
        ("TORQUE", "rated: 9 N*m", ": 9", "joints[0].torque.rated has no effect on a column in N*m"),
        ("TORQUE", "unit: A, constant: 1, rated: 9", ": 9", "joints[0].torque.rated has no effect on a column in A"),
        (
            "TORQUE",
            "unit: '%', rated: 9, constant: 4",
            ": 4",
            "joints[0].torque.constant has no effect on a column in %",
        ),
        ("TORQUE", "unit: A, constant: 0 N*m/A", ": 0", "joints[0].torque.constant is zero"),
        ("TORQUE", "unit: '%', rated: 0", ": 0", "joints[0].torque.rated is zero"),
        ("TORQUE", "wraps_at: 360", ": 360", "joints[0].torque has a wraps_at, which only a position has"),
        ("POSITION", "wraps_at: 0", ": 0", "joints[0].position.wraps_at must be positive"),
        ("POSITION", "limit: 9", ": 9", "joints[0].position has a limit, which only a torque has"),
        (
            *("MORE", "gear_ratio: 50", ": 50"),
            "joints[0].gear_ratio has no effect, because no signal of the joint is measured at the motor",
        ),
        ("ZERO", "0.1 mm", ": 0.1", "joints[0].zero: '0.1 mm' is not an expression"),
        ("GAP", "max_gap: -1 s", ": -1", "max_gap is negative"),
    ],
)
def test_keys_out_of_range_or_without_effect_are_refused_in_their_place(place, text, at, message):
    with pytest.raises(InputError) as caught:
        loads_mapping(described(**{place: text}))
    (fault,) = caught.value.faults
    line = described(**{place: text}).splitlines()[PLACES[place] - 1]
    assert fault.line == PLACES[place]
    assert fault.column >= line.rindex(at) + 3
    assert fault.message.startswith(message)
    assert fault.hint or "positive" in message


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ("POSITION", "unit: counts, resolution: 0.1 deg, wraps_at: 3600"),
        ("VELOCITY", "unit: counts/s, counts_per_turn: 4096"),
        ("TORQUE", "unit: mA, constant: -0.1 N*m/A, limit: 9"),
        ("TORQUE", "unit: '%', rated: 9 N*m, side: motor}\n    gear_ratio: 50\n    reference: {column: 4"),
        ("ZERO", "90 deg"),
        ("GAP", "max_gap: 0 s"),
    ],
)
def test_keys_with_an_effect_are_read(place, text):
    assert loads_mapping(described(**{place: text})).n == 1
