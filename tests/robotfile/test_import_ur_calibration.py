"""Calibrations of UR arms: the same arm as the lists say, far-off frames included."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.errors import InputError
from rrrgen.model import build_model
from rrrgen.robotfile.importers.importing import import_robot

FAR_AWAY = """\
# lists of an arm whose upper axes are nearly parallel
dh_theta: [ 1.25e-05, 0.8125,              -1.0625,           0.25,     -3.5e-07,  2.5e-08 ]
dh_a:     [ 3.5e-05,  0.0125,              -0.5625,           -5.5e-05, 6.25e-05,  0       ]
dh_d:     [ 0.1807,   321.0625,            -327.5,            6.625,    0.11983,   0.11567 ]
dh_alpha: [ 1.5703,   0.0017,              0.0063,            1.57,     -1.5704,   0       ]
hash: calib_1234
"""


def standard(theta, d, a, alpha) -> np.ndarray:
    """Rz(theta) Tz(d) Tx(a) Rx(alpha), entry by entry."""
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])


def matrix(transform) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = np.array(transform.R.evalf(30), dtype=float)
    T[:3, 3] = np.array(transform.p.evalf(30), dtype=float).ravel()
    return T


def columns(text: str) -> dict[str, list[float]]:
    lists = [line.split(":") for line in text.splitlines() if line.startswith("dh_")]
    return {key: [float(word) for word in values.strip(" []").split(",")] for key, values in lists}


def write(folder, content: str, name: str = "ur7.yaml"):
    (folder / name).write_text(content, encoding="utf-8")
    return folder / name


def test_the_robot_is_that_of_the_lists(tmp_path):
    found = import_robot(write(tmp_path, FAR_AWAY))
    assert (found.spec.name, found.format, found.spec.convention) == ("ur7", "ur-calibration", "standard")
    given = columns(FAR_AWAY)
    expected = list(zip(*(given[f"dh_{k}"] for k in ("alpha", "a", "d", "theta")), strict=True))
    assert [row[1:] for row in found.spec.dh_table()] == expected
    q = np.array([0.3, -1.2, 1.5, -0.4, 0.9, 2.0])
    T = np.eye(4)
    for k in range(6):
        T = T @ standard(given["dh_theta"][k] + q[k], given["dh_d"][k], given["dh_a"][k], given["dh_alpha"][k])
    assert np.linalg.norm(T[:3, 3]) < 2.0  # the frames are far away, the arm is not
    model = build_model(found.spec)
    tip = np.eye(4)
    for joint, angle in zip(model.joints, q, strict=True):
        tip = tip @ matrix(joint.before) @ standard(angle + float(joint.theta), 0, 0, 0)
    np.testing.assert_allclose(tip @ matrix(model.tip), T, atol=1e-11)


def test_what_is_far_away_or_missing_is_said(tmp_path):
    found = import_robot(write(tmp_path, FAR_AWAY), name="cell_3")
    said = [str(note) for note in found.notes]
    for joint, d in (("shoulder_lift", "321.062"), ("elbow", "-327.5"), ("wrist_1", "6.625")):
        assert any(f"d of {joint} is {d} m" in note for note in said), said
    assert not any("d of wrist_2" in note for note in said)
    assert any("'hash' is left out" in note for note in said)
    assert any("gravity and inertial parameters are not in a calibration" in note for note in said)
    assert found.spec.name == "cell_3"


FAULTS = {
    "five": ("0.11983,   0.11567", "0.11983", "4:11", "dh_d has 5 values instead of 6"),
    "no list": ("dh_alpha: [ 1.5703,   0.0017,              0.0063,            1.57,     -1.5704,   0       ]",
                "dh_alpha: 3", "5:11", "not a list"),
    "missing": ("dh_a: ", "dh_b: ", "2:1", "there is no list 'dh_a'"),
    "empty": ("0.8125", "~", "2:23", "an entry of dh_theta is nothing"),
    "too large": ("0.8125", "1e300 * 1e300", "2:23", "an entry of dh_theta is no finite number"),
    "word": ("0.8125", "os.getcwd()", "2:23", "dh_theta:"),
    "twice": ("hash:", "dh_a:", "6:1", "duplicate key 'dh_a'"),
    "yaml": ("hash:", "]", "6:1", "not valid YAML"),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTS)
def test_faults_are_located(case, tmp_path):
    old, new, place, message = FAULTS[case]
    assert FAR_AWAY.count(old) == 1
    file = write(tmp_path, FAR_AWAY.replace(old, new))
    with pytest.raises(InputError) as caught:
        import_robot(file)
    assert caught.value.exit_code == 3
    assert any(
        str(fault).startswith(f"{file}:{place}") and message in fault.message for fault in caught.value.faults
    ), str(caught.value)
