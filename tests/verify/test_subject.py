"""What is verified: models without links at random parameters, and single precision with tolerances of its own."""

from __future__ import annotations

import numpy as np

from oracles import chapter14
from rrrgen.verify import verify
from verify.distorted import FUNCTIONS, SAMPLES, Broken
from verify.oracle_model import OracleModel


def test_model_without_links_is_verified_with_random_parameters():
    report = verify(OracleModel(chapter14.rrr()), samples=SAMPLES)
    assert report.ok, report.to_text()
    assert {row.parameters for row in report.rows} == {"-", "random"}


class Single(OracleModel):
    """Answers rounded to single precision."""

    def __getattribute__(self, name: str):
        attribute = super().__getattribute__(name)
        if name in {*FUNCTIONS, "energy"}:
            return lambda *states, **options: _single(attribute(*states, **options))
        return attribute


def _single(value):
    return tuple(map(np.float32, value)) if isinstance(value, tuple) else np.asarray(value, dtype=np.float32)


def test_single_precision_has_its_own_tolerances(complete):
    report = verify(Single(complete.robot), samples=SAMPLES, libraries=False)
    assert report.ok, report.to_text()
    rounded = Broken(complete, "inverse_dynamics", lambda tau: np.float64(np.float32(tau)))
    assert not verify(rounded, samples=SAMPLES, libraries=False).ok
