"""The controller file: what it says is what is computed, and every fault is reported at once, in its place."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.lab.closed_loop.controller import Operation, filter_operation, load_controller, loads_controller
from rrrgen.lab.closed_loop.validation import validate_loop
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import open_log
from rrrgen.lab.data.uniform_stream import LogStream
from samples.linear_drive import CONTROLLER

FAULTY = """\
schema: rrrgen-controller/2
rate: 1 kHz
period: 1 ms
delay: -1
records: measured
joints:
  - name: j1
    signals:
      position: {sum: {reference: 1}}
      a: {difference: spede}
      b: {filter: position, numerator: 3}
      c: {filter: position, numerator: [1], denominator: [0, 1]}
      d: {limit: position}
      e: {sum: {position: 1, f: 2}}
      f: {sum: {position: 1}, limit: position}
      g: {delayed: position, by: 0}
      h: {limit: position, to: [3, 1]}
    torque: volts
  - {name: j1}
"""


def test_every_fault_is_reported_at_once_in_its_place():
    with pytest.raises(InputError) as caught:
        loads_controller(FAULTY)
    found = {(fault.line, fault.message) for fault in caught.value.faults}
    expected = [
        (1, "schema is 'rrrgen-controller/2'"),
        (1, "the controller file needs either 'rate' or 'period'"),
        (4, "delay is negative"),
        (5, "records is 'measured'"),
        (9, "a signal must not be called 'position'"),
        (10, "difference of signal 'a' is 'spede'"),
        (11, "numerator of 'b' is not a list"),
        (12, "denominator of 'c' starts with 0"),
        (13, "signal 'd' needs the key 'to'"),
        (14, "signal 'e' uses 'f'"),
        (15, "signal 'f' needs one operation"),
        (16, "'g' spans no sample"),
        (17, "limit 'h': the lowest value is not below the highest"),
        (18, "torque of 'j1' is 'volts'"),
        (19, "a second joint 'j1'"),
        (19, "joint 'j1' has no 'signals'"),
    ]
    assert [entry for entry in expected if entry not in found] == []


def test_differences_and_averages_are_filters():
    signals = loads_controller(CONTROLLER).joints[0].signals
    assert signals["averaged"] == filter_operation("position", (0.5, 0.5))
    assert signals["speed"] == filter_operation("averaged", (1000.0, -1000.0))
    assert signals["late"] == filter_operation("volts", (0.0, 1.0))


def test_an_integral_has_a_gain_and_limits():
    text = "schema: rrrgen-controller/1\nrate: 1 kHz\njoints: [one]\ntorque: i\n"
    found = loads_controller(text + "signals: {i: {integral: position, gain: 3, limit: [-2, 5]}}\n")
    assert found.joints[0].signals["i"] == Operation("integral", ("position",), (3e-3, -2.0, 5.0))


def test_signals_beside_the_joints_hold_for_all_of_them():
    text = "schema: rrrgen-controller/1\nperiod: 2 ms\nsignals: {u: {sum: {reference: 3, position: -3}}}\ntorque: u\n"
    found = loads_controller(text + "joints: [one, two]\n")
    assert found.names == ("one", "two")
    assert found.joints[0].signals == found.joints[1].signals
    assert found.period == pytest.approx(2e-3)


def test_settling_counts_the_slowest_pole():
    slow = filter_operation("position", (0.1,), (1.0, -0.9))
    text = "schema: rrrgen-controller/1\nrate: 1 kHz\nsignals: {u: {filter: position, numerator: [0.1], "
    found = loads_controller(text + "denominator: [1, -0.9]}}\ntorque: u\njoints: [one]\n")
    assert found.joints[0].signals["u"] == slow
    assert found.settling >= np.log(1e-4) / np.log(0.9)


def test_the_files_of_the_measured_axis_fit_together(tmp_path):
    """The controller of examples/emps, computed here along a motion, agrees with the voltage that the mapping reads."""
    for path in (Path(__file__).resolve().parents[3] / "examples/emps").glob("*.yaml"):
        shutil.copy(path, tmp_path)
    t = 1e-3 * np.arange(1500)
    r, dr = 0.02 * (1.0 - np.cos(2.0 * np.pi * t)), 0.04 * np.pi * np.sin(2.0 * np.pi * t)
    q = np.round((r - dr / 160.18) / 5e-8) * 5e-8  # the lag of a position loop
    pulses = np.where(t % 1.0 > 0.5, 5.0, 0.0)
    averaged = 0.5 * (q + np.r_[q[0], q[:-1]])
    speed = np.diff(averaged, prepend=averaged[0]) / 1e-3
    volts = 243.45 * (160.18 * (r - q) - speed) + 5.07 / 5.0 * pulses
    names = {"qm": q, "qg": r, "vir": volts, "pulses_N": pulses}
    savemat(tmp_path / "DATA_EMPS_PULSES.mat", {name: values[:, None] for name, values in names.items()})
    robot = tmp_path / "robot.yaml"
    text = robot.read_text().replace("viscous: 0, coulomb: 0", "viscous: 200, coulomb: 20")
    robot.write_text(
        text + "links:\n  - {mass: 95, com: [0, 0, 0], inertia: {about: com, products: tensor, xx: 1, yy: 1, zz: 1}}\n"
    )
    log = LogStream(open_log(tmp_path / "pulses-log.yaml"))
    controller = load_controller(tmp_path / "controller.yaml")
    found = validate_loop(rrrgen.compile(robot), controller, [log], Processing("differences"))
    assert found.replay.errors[0] < 2e-4
