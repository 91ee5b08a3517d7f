"""Links that are no bodies, in formats of rigid bodies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from emit.targets.compared import mujoco_answers, names_of, only, ours, states
from rrrgen.derive import derive_model
from rrrgen.exporting import export_robot
from rrrgen.robot.file import load_spec
from rrrgen.robot.spec import LinkSpec
from rrrgen.verify.references.numeric_robot import nominal_parameters


def test_links_that_are_no_bodies_are_lifted():
    """All of a link's mass moved to the link before: the same torques, which no simulator accepts as bodies."""
    spec = load_spec("rrr")
    model = derive_model(spec, ())
    K = np.array(model.base_projection, dtype=float)
    beta = K @ nominal_parameters(spec).ravel()
    exported = export_robot(replace(spec, links=None), "mjcf", dict(zip(names_of(model), beta, strict=True)))
    assert "15 base parameters" in exported.notes[0]
    q, dq, ddq = states(spec)
    _, torques = mujoco_answers(only(exported), spec, q, dq, ddq)
    np.testing.assert_allclose(torques, ours(spec, q, dq, ddq)[1], atol=1e-10)
    nothing = (0,) * 3
    weightless = LinkSpec(spec.links[0].mass * 0, nothing, (0,) * 6, "com")
    light = replace(spec, links=(weightless, *spec.links[1:]))
    exported = export_robot(light, "mjcf")
    assert "no bodies" in exported.notes[0]
    _, torques = mujoco_answers(only(exported), light, q, dq, ddq)
    np.testing.assert_allclose(torques, ours(light, q, dq, ddq)[1], atol=1e-10)
