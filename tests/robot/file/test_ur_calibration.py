"""Calibrations of UR arms: the same arm as the lists say, far-off frames included."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.model import build_model

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
    "too large": ("0.8125", "1e300 * 1e300", "2:23", "an entry of dh_theta is about 1e+600"),
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


NOMINAL = {
    "dh_theta": [0, 0, 0, 0, 0, 0],
    "dh_a": [0, -0.425, -0.3922, 0, 0, 0],
    "dh_d": [0.1625, 0, 0, 0.1333, 0.0997, 0.0996],
    "dh_alpha": [1.570796, 0, 0, 1.570796, -1.570796, 0],
}
WRONG_UNITS = {
    "dh_alpha": ([90, 0, 0, 90, -90, 0], "an entry of dh_alpha is 90 rad", "90 degrees are 1.5708"),
    "dh_theta": ([0, 0, 0, -180, 0, 0], "an entry of dh_theta is -180 rad", "-180 degrees are -3.14159"),
    "dh_a": ([0, -425, -392, 0, 0, 0], "an entry of dh_a is -425 m", "-425 mm are -0.425"),
    "dh_d": ([0.1625, 0, 0, 400, 0.0997, 0.0996], "the tip is 400", "lengths are in m"),
}


@pytest.mark.parametrize("key", WRONG_UNITS)
def test_degrees_and_millimetres_are_refused(key, tmp_path):
    def lists(columns):
        return "".join(f"{name}: {values}\n" for name, values in columns.items())

    assert import_robot(write(tmp_path, lists(NOMINAL))).spec.n == 6
    values, message, hint = WRONG_UNITS[key]
    with pytest.raises(InputError) as caught:
        import_robot(write(tmp_path, lists(NOMINAL | {key: values})))
    assert any(message in fault.message and hint in fault.hint for fault in caught.value.faults), caught.value
