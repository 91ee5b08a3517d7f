"""Identification of a mechanism in the coordinates of its drives, up to the robot file with consistent bodies."""

from __future__ import annotations

import numpy as np

import rrrgen
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.results import identified_spec
from rrrgen.robot.file import dumps, loads_spec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters
from samples.recordings import fourier_motion

# a planar parallelogram in a vertical plane: arm and crank are driven, rod and forearm follow
PARALLELOGRAM = """\
schema: rrrgen/1
name: parallelogram
convention: standard
units: {angle: deg, length: m}
gravity: [0, -9.81, 0]
joints:
  - {name: arm, type: revolute, alpha: 0, a: 0.5, d: 0}
  - {name: crank, type: revolute, alpha: 0, a: -0.15, d: 0, parent: base}
  - {name: rod, type: revolute, alpha: 0, a: 0.5, d: 0, follows: {arm: 1, crank: -1}}
  - {name: forearm, type: revolute, alpha: 0, a: 0.4, d: 0, parent: arm, follows: {arm: -1, crank: 1}}
tip: forearm
links:
  - {mass: 8, com: [-0.25, 0.01, 0], inertia: {about: com, xx: 0.02, yy: 0.2, zz: 0.21}}
  - {mass: 3, com: [0.07, 0, 0], inertia: {about: com, xx: 0.01, yy: 0.02, zz: 0.02}}
  - {mass: 1.5, com: [-0.25, 0, 0], inertia: {about: com, xx: 0.001, yy: 0.04, zz: 0.04}}
  - {mass: 5, com: [-0.2, 0.02, 0], inertia: {about: com, xx: 0.01, yy: 0.1, zz: 0.1}}
"""


def test_a_parallelogram_is_identified_from_torques_of_its_drives():
    spec = loads_spec(PARALLELOGRAM)
    truth = NewtonEuler(chain_of(spec), nominal_parameters(spec))
    t = 0.01 * np.arange(800)
    q, dq, ddq = fourier_motion(t, 2, 5, base=0.2)
    tau = truth.inverse_dynamics(q, dq, ddq) + 0.8 * dq
    log = Log(("arm", "crank"), t, q, tau + 0.05 * np.random.default_rng(0).normal(size=tau.shape))
    model = rrrgen.compile(spec, backend="numpy")
    terms = DriveTerms.everywhere(2, "viscous")
    found = identify(model, [log], Processing(), Options(terms=terms, poses=5))
    assert found.estimate.relative_error < 0.02
    told = identified_spec(spec, found.consistent)
    again = loads_spec(dumps(told))
    assert again.mechanism == spec.mechanism
    assert np.allclose([joint.friction.viscous for joint in again.joints], 0.8, rtol=0.05)
    states = np.random.default_rng(1).uniform(-2, 2, (3, 30, 2))
    wanted = truth.inverse_dynamics(*states)
    estimated = NewtonEuler(chain_of(again), nominal_parameters(again)).inverse_dynamics(*states)
    assert np.abs(estimated - wanted).max() < 0.05 * np.abs(wanted).max()
