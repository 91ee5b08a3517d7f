"""Recordings given as arrays: points in time, masks and tables of other libraries."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.lab.studies.sources import checked_arrays, recording_inputs, response_input, single_recording
from rrrgen.robot.file import load_spec

STEPS = np.arange(6) * 5_000_000  # ns
SECONDS = STEPS / 1e9
Q = np.linspace(0.0, 1.0, 6)


class Frame:
    """What distinguishes a data frame of pandas or polars: columns by name, and iteration over their names."""

    columns = ("t", "q")

    def __iter__(self):
        return iter(self.columns)

    def __getitem__(self, name):
        return {"t": SECONDS, "q": Q}[name]


def times(t):
    return checked_arrays({"t": t, "q": Q}, 1, "log")["t"]


@pytest.mark.parametrize("start", ["2024-02-28T23:59:59.995", "1969-12-31T23:59:59.99"])
@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_points_in_time_are_seconds_from_the_first(start, unit):
    at = np.datetime64(start, unit) + STEPS.astype("m8[ns]").astype(f"m8[{unit}]")
    np.testing.assert_array_equal(times(at), SECONDS)
    np.testing.assert_array_equal(times(at - at[0] + np.timedelta64(7, "s")), SECONDS)


def test_points_in_time_of_python_are_seconds_from_the_first():
    start = datetime(2024, 3, 31, 0, 59, 59, 990000, tzinfo=UTC)
    steps = [timedelta(microseconds=int(step) // 1000) for step in STEPS]
    np.testing.assert_array_equal(times([start + step for step in steps]), SECONDS)
    np.testing.assert_array_equal(times(steps), SECONDS)


def test_a_missing_point_in_time_is_refused():
    at = np.datetime64("2024-01-01", "ns") + STEPS.astype("m8[ns]")
    at[3] = np.datetime64("NaT")
    with pytest.raises(InputError, match=r"'t' has no time \(NaT\) in row 3"):
        times(at)
    with pytest.raises(InputError, match=r"'t' counts in M, which is no fixed time"):
        times(np.arange(6).astype("M8[M]"))


@pytest.mark.parametrize("kind", ["M8[ns]", "m8[us]"])
def test_points_in_time_are_no_signal(kind):
    with pytest.raises(InputError, match=r"'q' holds points in time .*, which only t may"):
        checked_arrays({"t": SECONDS, "q": STEPS.astype(kind)}, 1, "log")


def test_complex_numbers_are_no_signal():
    with pytest.raises(InputError, match="'q' does not hold numbers"):
        checked_arrays({"t": SECONDS, "q": Q + 1j}, 1, "log")


def test_masked_values_are_missing():
    mask = np.array([False, True, False, False, True, False])
    q = checked_arrays({"t": SECONDS, "q": np.ma.array(Q, mask=mask)}, 1, "log")["q"]
    np.testing.assert_array_equal(q[:, 0], np.where(mask, np.nan, Q))
    whole = checked_arrays({"t": SECONDS, "q": np.ma.array(np.arange(6), mask=mask)}, 1, "log")["q"]
    np.testing.assert_array_equal(np.isnan(whole[:, 0]), mask)


def test_a_data_frame_is_told_what_is_taken():
    expected = r"of type Frame, .*\{'t': frame\['t'\], 'q': frame\[\["
    for frames in (Frame(), [Frame()]):
        with pytest.raises(InputError, match=expected):
            recording_inputs(frames, load_spec("rrr"))
        with pytest.raises(InputError, match="of type Frame"):
            response_input(frames)
    with pytest.raises(InputError, match=expected):
        single_recording(Frame())
