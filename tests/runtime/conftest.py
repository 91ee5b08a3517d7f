"""Fixtures that several test files of this folder share."""

from __future__ import annotations

import numpy as np
import pytest

from emit.c_tools import IDENTITY
from emit.planar import planar_model
from rrrgen.runtime.load import load_model


@pytest.fixture(scope="module")
def model():
    model = load_model(planar_model(), IDENTITY)
    model.engine.prepare()
    return model


@pytest.fixture(scope="module")
def reference():
    return load_model(planar_model(), IDENTITY, "numpy")


@pytest.fixture(scope="module")
def states():
    return np.random.default_rng(1).uniform(-2, 2, (4, 7, 2))
