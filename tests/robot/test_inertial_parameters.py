"""Standard parameters: their order, and the way to a link and back."""

from __future__ import annotations

import numpy as np

from rrrgen.robot.file import load_spec
from rrrgen.robot.spec import link_of, standard_names, standard_parameters
from rrrgen.verify.references.numeric_robot import nominal_parameters


def test_names():
    assert standard_names(2)[:11] == ("m1", "mx1", "my1", "mz1", "Ixx1", "Ixy1", "Iyy1", "Ixz1", "Iyz1", "Izz1", "m2")


def test_values_are_those_of_the_independent_chain():
    for robot in ("rrr", "puma560", "stanford"):
        spec = load_spec(robot)
        found = np.array([standard_parameters(link) for link in spec.links], float)
        assert np.allclose(found, nominal_parameters(spec), rtol=1e-14, atol=1e-300)


def test_a_link_comes_back():
    for link in load_spec("puma560").links:
        phi = np.array(standard_parameters(link), float)
        if phi[0]:
            assert np.allclose(np.array(standard_parameters(link_of(phi)), float), phi, rtol=1e-14, atol=1e-18)
