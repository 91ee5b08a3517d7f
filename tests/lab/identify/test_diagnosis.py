"""Every usual fault of a recording or a robot file is named with evidence and remedy, alone; sound ones are not."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.cli.main import cli
from rrrgen.lab.data.mapping import loads_mapping
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log, open_log
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.lab.identify.diagnosis.causes import Wording, merge_causes
from rrrgen.lab.identify.diagnosis.report import diagnose_fit, diagnose_recordings
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.lab.identify.parameters import DriveTerms
from samples.recordings import SHARED, fourier_motion, write_log

PERIOD, N = 2e-3, 2500
KALMAN = Processing("kalman", decimate=5)
FAULTY = ("planar2r", "rrr")
SOUND = ("pendulum", "planar2r", "rrr", "gantry", "scara")


def within_limits(spec, q, dq, ddq):
    """The same motion scaled to the limits of the robot file."""
    for j, joint in enumerate(spec.joints):
        limits, middle, scale = joint.limits, 0.0, 1.0
        q[:, j] -= np.mean(q[:, j])
        if limits.lower is not None:
            middle = 0.5 * (limits.lower + limits.upper)
            scale = min(scale, 0.45 * (limits.upper - limits.lower) / np.max(np.abs(q[:, j])))
        if limits.velocity is not None:
            scale = min(scale, 0.9 * limits.velocity / np.max(np.abs(dq[:, j])))
        q[:, j], dq[:, j], ddq[:, j] = middle + scale * q[:, j], scale * dq[:, j], scale * ddq[:, j]
    return q, dq, ddq


def recorded(name, noise=0.02, friction=True, seed=1):
    """An arm and its recording: friction a tenth of the RMS torque each, white noise, an encoder of 1e-6."""
    arm = rrrgen.compile(name)
    t = PERIOD * np.arange(N)
    q, dq, ddq = within_limits(arm.spec, *fourier_motion(t, arm.n, seed, base=0.2, harmonics=8, size=0.5))
    tau = np.array(arm.inverse_dynamics(q, dq, ddq))
    size = np.sqrt(np.mean(tau**2, axis=0))
    size = np.maximum(size, 1e-3 * np.max(size))
    if friction:
        tau += 0.1 * size * (np.sign(dq) + dq / np.sqrt(np.mean(dq**2, axis=0)))
    tau += noise * size * np.random.default_rng(seed).normal(size=tau.shape)
    names = tuple(joint.name for joint in arm.spec.joints)
    return arm, Log(names, t, np.round(q / 1e-6) * 1e-6, tau, period=PERIOD), dq


@pytest.fixture(scope="module")
def sound():
    return {name: recorded(name) for name in FAULTY}


def causes(arm, log, terms=None, processing=None):
    chosen = DriveTerms.everywhere(arm.n, "viscous", "coulomb") if terms is None else terms
    options = Options(terms=chosen, consistent=False, poses=10)
    found = identify(arm, [log], processing or Processing("butterworth", cutoff=25.0, decimate=5), options)
    return merge_causes([*diagnose_recordings(arm.spec, [log]), *diagnose_fit(arm, [log], found)])


def told(found):
    return [each.cause for each in found]


def changed(log, **values):
    return replace(log, **values)


def slow(log):
    """Milliseconds read as seconds; no filter with a cutoff in Hz could be run on it."""
    return changed(log, t=1e3 * log.t, period=1e3 * log.period)


def turned(values, joint, factor=-1.0):
    return values * np.where(np.arange(values.shape[1]) == joint, factor, 1.0)


def exchanged(values, i, k):
    order = np.arange(values.shape[1])
    order[[i, k]] = k, i
    return values[:, order]


@pytest.mark.parametrize(
    ("name", "noise"),
    [
        *((name, 0.02) for name in SOUND),
        pytest.param("puma560", 0.02, marks=pytest.mark.sweep),
        *((name, 0.3) for name in FAULTY),
    ],
)
@pytest.mark.sweep(but=["rrr-0.3", "scara-0.02", "pendulum-0.02", "gantry-0.02"])
def test_sound_recordings_pass_in_silence(name, noise):
    arm, log, _ = recorded(name, noise)
    assert causes(arm, log) == ()


@pytest.mark.parametrize("name", ["tx40", "delan"])
def test_published_recordings_pass_in_silence(name):
    if not SHARED.exists():
        pytest.skip("the published recordings are not beside the project")
    examples = Path(__file__).resolve().parents[3] / "examples" / name
    arm, mapping = rrrgen.compile(examples / "robot.yaml"), open_log(examples / "log.yaml")
    terms = DriveTerms.of_spec(arm.spec)
    assert causes(arm, LogStream(mapping), terms, Processing(**mapping.processing)) == ()


@pytest.mark.parametrize("name", ["rrr", pytest.param("planar2r", marks=pytest.mark.sweep)])
class TestFaults:
    def test_degrees_read_as_radians(self, sound, name):
        arm, log, _ = sound[name]
        (found,) = causes(arm, changed(log, q=np.degrees(log.q)))
        assert found.cause == "the positions of all joints are in deg, but are read in rad"
        assert "units: {position: deg}" in found.remedy
        assert found.evidence

    def test_degrees_at_one_joint(self, sound, name):
        arm, log, _ = sound[name]
        found = causes(arm, changed(log, q=turned(log.q, 0, 180 / np.pi)))
        assert told(found) == ["the positions of joint q1 are in deg, but are read in rad"]
        assert "joint q1: position: {column: the column of joint q1, unit: deg}" in found[0].remedy

    @pytest.mark.parametrize("joint", [0, 1])
    def test_a_position_with_the_other_sign(self, sound, name, joint):
        arm, log, _ = sound[name]
        (found,) = causes(arm, changed(log, q=turned(log.q, joint)))
        # turning joint 1 of the RRR mirrors the arm: there the torque may as well be the wrong one
        assert found.cause in (
            f"the position of joint q{joint + 1} has the wrong sign",
            f"the torque or the position of joint q{joint + 1} has the wrong sign",
        )
        assert "sign: -1" in found.remedy

    @pytest.mark.parametrize("joint", [0, 1])
    def test_a_torque_with_the_other_sign(self, sound, name, joint):
        arm, log, _ = sound[name]
        (found,) = causes(arm, changed(log, tau=turned(log.tau, joint)))
        assert found.cause in (
            f"the torque of joint q{joint + 1} has the wrong sign",
            f"the torque or the position of joint q{joint + 1} has the wrong sign",
        )
        assert any("%" in sentence for sentence in found.evidence)

    def test_two_faults_at_once(self, sound, name):
        arm, log, _ = sound[name]
        found = causes(arm, changed(log, tau=turned(log.tau, 1), q=np.degrees(log.q)))
        assert set(told(found)) == {
            "the positions of all joints are in deg, but are read in rad",
            "the torque of joint q2 has the wrong sign",
        }

    def test_exchanged_torques(self, sound, name):
        arm, log, _ = sound[name]
        (found,) = causes(arm, changed(log, tau=exchanged(log.tau, 0, 1)))
        assert found.cause == "the torques of joints q1 and q2 are exchanged"

    def test_exchanged_positions(self, sound, name):
        arm, log, _ = sound[name]
        (found,) = causes(arm, changed(log, q=exchanged(log.q, 0, 1)))
        assert found.cause == "the positions of joints q1 and q2 are exchanged"

    @pytest.mark.parametrize(("factor", "unit"), [(1e3, "mN*m"), (1e-3, "kN*m")])
    def test_torques_in_another_unit(self, sound, name, factor, unit):
        arm, log, _ = sound[name]
        (found,) = causes(arm, changed(log, tau=factor * log.tau))
        assert found.cause == f"the torques of all joints are in {unit}, but are read in N*m"
        assert f"units: {{torque: {unit}}}" in found.remedy

    def test_torques_of_one_joint_in_another_unit(self, sound, name):
        arm, log, _ = sound[name]
        (found,) = causes(arm, changed(log, tau=turned(log.tau, 1, 1e3)))
        assert found.cause == "the torques of joint q2 are in mN*m, but are read in N*m"

    def test_torques_in_another_unit_without_links(self, sound, name):
        """The links of the robot file are no witness here: the reach is."""
        arm, log, _ = sound[name]
        bare = rrrgen.compile(replace(arm.spec, links=None, joints=tuple(_bare(j) for j in arm.spec.joints)))
        assert causes(bare, log) == ()
        (found,) = causes(bare, changed(log, tau=1e3 * log.tau))
        assert found.cause == "the torques of all joints are in mN*m, but are read in N*m"
        (found,) = causes(bare, slow(log), processing=KALMAN)
        assert found.cause == "the clock is in ms, but is read in s"

    def test_a_clock_in_milliseconds(self, sound, name):
        arm, log, _ = sound[name]
        (found,) = causes(arm, slow(log), processing=KALMAN)
        assert found.cause == "the clock is in ms, but is read in s"
        assert "time: {column: t, unit: ms}" in found.remedy

    @pytest.mark.parametrize(("scale", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
    def test_a_clock_in_any_unit_is_named(self, sound, name, scale, unit):
        arm, log, dq = sound[name]
        for read in (log, changed(log, dq=dq)):  # recorded speeds are a second witness
            (found,) = diagnose_recordings(arm.spec, [changed(read, t=scale * log.t, period=scale * log.period)])
            assert found.cause == f"the clock is in {unit}, but is read in s"
            assert f"time: {{column: t, unit: {unit}}}" in found.remedy
        assert len(found.evidence) == 2

    def test_friction_that_the_robot_file_does_not_ask_for(self, sound, name):
        arm, log, _ = sound[name]
        found = causes(arm, log, DriveTerms())
        assert told(found) == [f"friction of joint {joint} is not in the model" for joint in log.joints]
        assert "friction: {viscous: 0, coulomb: 0} at joint q1" in found[0].remedy
        only_one = DriveTerms(viscous=tuple(range(1, arm.n)), coulomb=tuple(range(1, arm.n)))
        assert told(causes(arm, log, only_one)) == ["friction of joint q1 is not in the model"]

    def test_an_offset_that_the_robot_file_does_not_ask_for(self, sound, name):
        arm, log, _ = sound[name]
        size = np.sqrt(np.mean(log.tau[:, 0] ** 2))
        shifted = log.tau + np.where(np.arange(arm.n) == 0, 0.3 * size, 0.0)
        found = causes(arm, changed(log, tau=shifted))
        assert told(found) == ["a constant torque (offset) of joint q1 is not in the model"]

    @pytest.mark.parametrize(
        ("factor", "cause"),
        [
            (180 / np.pi, "the speeds of joint q2 are in deg/s, but are read in rad/s"),
            (-1.0, "the position or the speed of joint q2 has the wrong sign"),
            (30 / np.pi, "the speeds of joint q2 are in rpm, but are read in rad/s"),
        ],
    )
    def test_recorded_speeds_that_do_not_follow_the_positions(self, sound, name, factor, cause):
        arm, log, dq = sound[name]
        assert diagnose_recordings(arm.spec, [changed(log, dq=dq)]) == ()
        (found,) = diagnose_recordings(arm.spec, [changed(log, dq=turned(dq, 1, factor))])
        assert found.cause == cause
        assert "should be 1" in found.evidence[0]

    def test_recorded_speeds_of_another_joint_and_another_clock(self, sound, name):
        arm, log, dq = sound[name]
        (found,) = diagnose_recordings(arm.spec, [changed(log, dq=exchanged(dq, 0, 1))])
        assert found.cause == "the speeds of joints q1 and q2 are exchanged"
        (found,) = diagnose_recordings(arm.spec, [slow(changed(log, dq=dq))])
        assert found.cause == "the clock is in ms, but is read in s"
        assert len(found.evidence) == 2


def _bare(joint):
    return replace(joint, limits=replace(joint.limits, torque=None, velocity=None))


def test_an_error_that_no_rule_explains_is_told_as_such(sound):
    arm, log, _ = sound["planar2r"]
    slow = np.cumsum(np.random.default_rng(0).normal(size=log.tau.shape), axis=0)
    other = slow / np.sqrt(np.mean(slow**2, axis=0)) * np.sqrt(np.mean(log.tau**2, axis=0))
    found = causes(arm, changed(log, tau=log.tau + other))
    assert found
    assert all(each.cause.startswith("the model does not describe joint") or "offset" in each.cause for each in found)


MAPPING = """
schema: rrrgen-log/1
files: log.csv
time: {column: t, unit: ms}
units: {position: deg, torque: N*m}
joints:
  - {name: q1, position: {column: enc_1, sign: -1}, torque: i_1}
  - {name: q2, position: enc_2, torque: i_2}
"""


def test_remedies_are_lines_of_the_mapping_file():
    words = Wording(("q1", "q2"), (True, True), loads_mapping(MAPPING, "log.yaml"))
    assert words.wrong_sign(["position"], 0).remedy == "joint q1: position: {column: enc_1, sign: 1}, in log.yaml"
    assert words.wrong_unit("position", [0, 1], 180 / np.pi).remedy == "units: {position: rad}, in log.yaml"
    assert words.exchanged_columns("torque", 0, 1).remedy == (
        "joint q1: torque: {column: i_2}; joint q2: torque: {column: i_1}, in log.yaml"
    )
    assert words.clock(1e3).remedy == "time: {column: t, unit: s}, in log.yaml"
    corrected = MAPPING.replace("{column: enc_1, sign: -1}", "{column: enc_1, sign: 1}")
    assert loads_mapping(corrected, "log.yaml").joints[0].position.sign == 1.0


def test_identify_and_validate_print_and_store_it(sound, tmp_path):
    _, log, _ = sound["planar2r"]
    write_log(tmp_path / "log.csv", changed(log, q=np.degrees(log.q)))
    for command, record in (("identify", "identification.json"), ("validate", "validation.json")):
        out = tmp_path / command
        options = ["--no-consistent"] if command == "identify" else []
        arguments = [command, "planar2r", "--log", tmp_path / "log.csv", *options, "-o", out]
        result = CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False)
        assert "diagnosis: the positions of all joints are in deg, but are read in rad" in result.stdout
        assert "write instead: units: {position: deg}, in a mapping file" in result.stdout
        assert "evidence: positions beyond the limits of the robot file" in result.stdout
        stored = json.loads((out / "results" / record).read_text())["diagnoses"]
        assert stored[0]["write_instead"].startswith("units: {position: deg}")
