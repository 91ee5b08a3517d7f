"""Inputs of the controller in a recording: values that are no finite numbers are refused where they are used."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.lab.closed_loop.controller import loads_controller
from rrrgen.lab.closed_loop.joint_friction import _OneJoint
from rrrgen.lab.closed_loop.loop_recording import loop_recordings
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log, open_log
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.lab.studies.sources import mapping_of_arrays

INPUTS = ("reference", "reference_velocity", "feedforward")
CONTROLLER = """
schema: rrrgen-controller/1
rate: 1 kHz
signals:
  force: {sum: {position: -9, reference: 9, reference_velocity: 2, feedforward: 1}}
torque: force
joints: [a, b]
"""
MAPPING = """
schema: rrrgen-log/1
files: log.csv
time: {column: t, unit: s}
joints:
  - {name: a, position: {column: q, unit: rad}, torque: {column: u, unit: N*m}, reference: {column: ra, unit: rad}}
  - {name: b, position: {column: q, unit: rad}, torque: {column: u, unit: N*m}, reference: {column: rb, unit: rad}}
"""
SAMPLES = 80
MOTION = np.sin(0.1 * np.arange(SAMPLES))[:, None] * [1.0, 2.0]


def arrays_with(signal, value):
    """Arrays of a recording in which ``signal`` of joint b has ``value`` in row 41, counted from 1."""
    arrays = {name: MOTION.copy() for name in ("q", "tau", *INPUTS)}
    arrays[signal][40, 1] = value
    return {"t": 1e-3 * np.arange(SAMPLES)} | arrays


def prepared(recording, text=CONTROLLER):
    return loop_recordings([recording], loads_controller(text), Processing("differences"))


@pytest.mark.parametrize("signal", INPUTS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_an_input_that_is_no_number_is_refused_with_row_and_column(signal, value):
    recording = LogStream(mapping_of_arrays(arrays_with(signal, value), ("a", "b"), "log2"))
    with pytest.raises(InputError, match=f"log2: error: column '{signal}_b' has no number in row 41"):
        prepared(recording)


def test_in_a_file_the_row_is_that_of_the_data_and_rows_left_out_do_not_count(tmp_path):
    arrays = arrays_with("reference", np.nan)
    arrays["reference"][3:, 0] = 0.5
    arrays["q"][20, 0] = arrays["reference"][20, 1] = np.nan  # a row without position is left out
    columns = arrays["t"], arrays["q"][:, 0], arrays["tau"][:, 0], *arrays["reference"].T
    np.savetxt(tmp_path / "log.csv", np.column_stack(columns), delimiter=",", header="t,q,u,ra,rb", comments="")
    (tmp_path / "log.yaml").write_text(MAPPING)
    text = CONTROLLER.replace("reference_velocity: 2, feedforward: 1", "constant: 0")
    with pytest.raises(InputError, match=r"log\.csv: error: column 'rb' has no number in row 41"):
        prepared(LogStream(open_log(tmp_path / "log.yaml")), text)


def test_of_one_joint_only_its_own_input_counts():
    text = CONTROLLER.replace("[a, b]", "[JOINT]")
    arrays = arrays_with("reference", np.nan)
    log = Log(("a", "b"), **arrays)
    assert len(prepared(_OneJoint(log, 0), text.replace("JOINT", "a"))) == 1
    with pytest.raises(InputError, match=r"the reference of joint b is no finite number at t = 0\.04 s"):
        prepared(_OneJoint(log, 1), text.replace("JOINT", "b"))


@pytest.mark.parametrize("signal", INPUTS)
def test_an_input_that_the_controller_does_not_use_may_be_no_number(signal):
    recording = LogStream(mapping_of_arrays(arrays_with(signal, np.nan), ("a", "b"), "log"))
    (loop,) = prepared(recording, CONTROLLER.replace(f"{signal}:", "constant:"))
    for name in INPUTS:
        assert np.isfinite(getattr(loop, name)).all(), name
    assert np.isfinite(loop.bounds).all()
