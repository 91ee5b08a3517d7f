"""The arm angle of a configuration: the redundancy parameter of arms with spherical shoulder and wrist."""

from __future__ import annotations

from typing import Any

from rrrgen.ik.geometry.chain import Chain


def arm_angle(chain: Chain, q: Any) -> float:
    """Arm angle psi (rad) of a seven-joint configuration ``q``: rotation of the elbow about the line shoulder-wrist.

    psi is zero where the elbow lies on the side of a reference direction, the stereographic one that
    :mod:`rrrgen.ik.solutions.elbow7` defines. The result is 0 where psi is undefined: where the arm is straight, or
    where the line from shoulder to wrist has the single direction for which there is no reference direction.
    """
    import numpy as np

    T = np.eye(4)
    frames = []
    for i, joint in enumerate(chain.joints):
        x = joint.sign * float(q[joint.index]) + float(joint.offset)
        frames.append(T.copy())
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(x), -np.sin(x)], [np.sin(x), np.cos(x)]]
        after = np.eye(4)
        after[:3] = np.array(chain.links[i].matrix() if i < chain.n - 1 else chain.tip, dtype=float)
        T = T @ turn @ after
    shoulder = np.array([0.0, 0.0, float(chain.links[0].d)])
    elbow, wrist = frames[3][:3, 3], frames[5][:3, 3]
    away = wrist - shoulder
    size = float(np.linalg.norm(away))
    if size == 0.0:
        return 0.0
    e = away / size
    n = np.cross(np.cross(e + np.array([0.0, 0.0, 1.0]), [1.0, 0.0, 0.0]), e)
    if float(np.linalg.norm(n)) == 0.0:
        return 0.0
    y = n / np.linalg.norm(n)
    across = elbow - shoulder
    return float(np.arctan2(across @ np.cross(e, y), across @ y))
