"""Pictures of an arm: the links pass the origins of all frames, along z by d and along x by a."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from rrrgen.runtime.display import corners


@pytest.mark.parametrize("robot", ["rrr", "panda", "scara"])  # standard, modified, prismatic
def test_links_follow_the_table(robot: str) -> None:
    m = rrrgen.compile(robot, backend="numpy")
    q = np.random.default_rng(3).uniform(-1, 1, (4, m.n))
    path = corners(m.spec, m.link_frames(q), m.forward_kinematics(q))
    assert path.shape == (4, 2 * m.n + 2, 3)
    np.testing.assert_allclose(path[:, 2:-1:2], m.link_frames(q)[..., :3, 3], atol=1e-14)
    np.testing.assert_allclose(path[:, -1], m.forward_kinematics(q)[:, :3, 3], atol=1e-14)
    steps = np.linalg.norm(np.diff(path[:, :-1], axis=1), axis=-1).reshape(4, m.n, 2)
    along_z, along_x = np.moveaxis(steps, -1, 0)[:: 1 if m.spec.convention == "standard" else -1]
    slide = np.array([0.0 if joint.is_revolute else 1.0 for joint in m.spec.joints]) * q
    _, _, a, d, _ = zip(*m.spec.dh_table(), strict=True)
    np.testing.assert_allclose(along_x, np.broadcast_to(np.abs(a), along_x.shape), atol=1e-14)
    np.testing.assert_allclose(along_z, np.abs(np.array(d) + slide), atol=1e-14)


def test_pictures_and_their_errors() -> None:
    pytest.importorskip("matplotlib").use("Agg")
    m = rrrgen.compile("planar2r", backend="numpy")
    ax = m.plot([[0.1, 0.2], [0.3, 0.4]])
    assert len(ax.lines) == 2 * (1 + 3 * 3)
    assert len(m.plot([0.1, 0.2], frames=False).lines) == 1
    t = np.linspace(0, 1, 51)
    film = m.animate(t, np.outer(t, [1.0, 2.0]), ax)
    film._draw_was_started = True  # it is not shown here
    assert len(list(film.new_frame_seq())) == 25
    with pytest.raises(ValueError, match=r"\(k, 2\)"):
        m.plot([1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="increasing"):
        m.animate(t[::-1], np.outer(t, [1.0, 2.0]))


def test_pictures_without_positions_say_so() -> None:
    """Out of reach ``q`` is empty; in a batch NaN stands behind the solutions of a target."""
    pytest.importorskip("matplotlib").use("Agg")
    m = rrrgen.compile("planar2r", backend="numpy")
    target = m.forward_kinematics([0.3, 0.4])[:3, 3]
    none, batch = m.inverse_kinematics(100.0 * target), m.inverse_kinematics([target, 100.0 * target])
    for q in (none.q, batch.q[1], [np.inf, 0.0]):
        with pytest.raises(ValueError, match="no finite joint positions to plot"):
            m.plot(q)
    assert len(m.plot(batch.q[0], frames=False).lines) == batch.counts[0] == 2
    padded = np.vstack([batch.q[0], np.full(2, np.nan)])
    assert len(m.plot(padded, frames=False).lines) == 2
    with pytest.raises(ValueError, match="must be finite to be plotted; row 1 is not"):
        m.plot([[0.1, 0.2], [np.nan, 0.2]])
    with pytest.raises(ValueError, match="must be finite to be plotted; row 1 is not"):
        m.animate([0.0, 1.0], [[0.1, 0.2], [np.nan, np.nan]])
