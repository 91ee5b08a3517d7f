"""A recording as the reference of a simulation: the same motion, and its faults."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.cli.main import run
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.experiment.feedback_linearisation import RecordedMotion
from rrrgen.runtime import load
from samples.recordings import fourier_motion, write_log


def log(seconds=4.0, noise=1e-5):
    t = 3.0 + 0.01 * np.arange(round(seconds / 0.01))
    q, dq, ddq = fourier_motion(t - 3.0, 2, 4, base=0.25, harmonics=3, size=0.3)
    measured = q + noise * np.random.default_rng(0).normal(size=q.shape)
    return Log(("q1", "q2"), t, measured, np.zeros_like(q), period=0.01), (q, dq, ddq)


def test_the_motion_is_that_of_the_recording_between_samples_too():
    recording, _ = log()
    motion = RecordedMotion.of(recording, Processing())
    assert motion.duration == pytest.approx(3.99)
    t = np.linspace(0.3, 3.6, 777)
    truth = fourier_motion(t, 2, 4, base=0.25, harmonics=3, size=0.3)
    for mine, wanted, most in zip(motion.evaluate(t), truth, (1e-4, 5e-3, 0.05), strict=True):
        assert np.abs(mine - wanted).max() < most * np.abs(wanted).max()
    after = motion.evaluate(np.array([5.0]))
    assert not np.any(after[1])
    assert after[0][0] == pytest.approx(motion.evaluate(np.array([3.99]))[0][0])


def test_an_interrupted_reference_is_refused():
    recording, _ = log()
    cut = replace(recording, segment=(np.arange(400) > 200).astype(np.int64))
    with pytest.raises(InputError, match="the reference has 2 stretches"):
        RecordedMotion.of(cut, Processing())


def test_simulate_follows_a_recording(tmp_path, monkeypatch):
    monkeypatch.setattr(load, "compile", partial(load.compile, backend="numpy"))
    recording, (q, _, _) = log(1.0)
    write_log(tmp_path / "log.csv", recording)
    words = [
        "experiment",
        "simulate",
        "planar2r",
        "--reference",
        str(tmp_path / "log.csv"),
        "--control",
        "computed-torque",
    ]
    assert run([*words, "--rate", "200", "-o", str(tmp_path / "run")]) == 0
    found = np.genfromtxt(tmp_path / "run" / "results" / "log.csv", delimiter=",", names=True)
    followed = np.column_stack([found["q_q1"], found["q_q2"]])
    assert followed[::2] == pytest.approx(q[: len(followed[::2])], abs=5e-3)
    assert run([*words, "--writing", "-o", str(tmp_path / "both")]) == 2
