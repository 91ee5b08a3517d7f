"""Measurements that do not belong to the robot are refused, with the mistake where it is a usual one."""

from __future__ import annotations

import numpy as np
import pytest

from lab.calibrate.mistakes_study import outcome
from lab.calibrate.virtual import NOISE, measure, off_the_table, positions
from rrrgen.base.errors import InputError
from rrrgen.lab.calibrate.diagnosis import estimate_checked
from rrrgen.lab.calibrate.geometry import rigid
from rrrgen.lab.calibrate.measurements import read_table
from rrrgen.robot.file import load_spec


def written(file, q, T, **changes):
    """Write poses to ``file`` with roll, pitch and yaw, columns changed by functions; returns the table read again."""
    R = T[:, :3, :3]
    columns = {f"q{k + 1}": q[:, k] for k in range(q.shape[1])} | {name: T[:, k, 3] for k, name in enumerate("xyz")}
    columns |= {"roll": np.arctan2(R[:, 2, 1], R[:, 2, 2]), "pitch": -np.arcsin(R[:, 2, 0])}
    columns |= {"yaw": np.arctan2(R[:, 1, 0], R[:, 0, 0])}
    columns = {name: changes.get(name, lambda x: x)(x) for name, x in columns.items()}
    rows = "\n".join(",".join(repr(float(x)) for x in row) for row in np.column_stack(list(columns.values())))
    file.write_text(",".join(columns) + "\n" + rows + "\n")
    return read_table(file, [f"q{k + 1}" for k in range(q.shape[1])])


DEGREES, MILLIMETRES = {f"q{k}": np.degrees for k in (1, 2, 3)}, dict.fromkeys("xyz", lambda x: 1e3 * x)
MISTAKES = {
    "both": (DEGREES | MILLIMETRES, "joint positions in deg and lengths in mm: write units in the header"),
    "sign": ({"q3": lambda x: -x}, "they fit with q3 reversed: 'sign: -1' at joint 3"),
    "unknown": ({"q3": lambda x: x[::-1]}, "compare units, the order of columns and of rotations"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_measurements_of_another_robot_are_refused_with_the_mistake(case, tmp_path):
    spec, random = load_spec("rrr"), np.random.default_rng(1)
    nominal, true = off_the_table(spec, random)
    q = positions(spec, 30, random)
    table = written(tmp_path / "m.csv", q, measure("pose", true, q, random).values, **MISTAKES[case][0])
    with pytest.raises(InputError, match=r"m.csv:1:1: error: the measurements do not fit this robot") as caught:
        estimate_checked(nominal, table.measurements(NOISE, 1e-4), table)
    assert MISTAKES[case][1] in str(caught.value)


@pytest.mark.parametrize("lengths", [False, True])
@pytest.mark.sweep(but=["True"])
def test_a_slide_in_mm_is_found(lengths, tmp_path):
    """The third joint of the SCARA slides; its unit was taken for right, and nothing fitted."""
    spec, random = load_spec("scara"), np.random.default_rng(1)
    nominal, true = off_the_table(spec, random)
    q = positions(spec, 30, random)
    changes = {"q3": lambda x: 1e3 * x} | (MILLIMETRES if lengths else {})
    table = written(tmp_path / "m.csv", q, measure("pose", true, q, random).values, **changes)
    with pytest.raises(InputError) as caught:
        estimate_checked(nominal, table.measurements(NOISE, 1e-4), table)
    expected = (
        "sliding joints in mm and lengths in mm" if lengths else "they fit with sliding joints in mm: write units"
    )
    assert expected in str(caught.value)


def test_columns_that_were_exchanged_are_found(tmp_path):
    spec, random = load_spec("rrr"), np.random.default_rng(1)
    nominal, true = off_the_table(spec, random)
    q = positions(spec, 30, random)
    T = measure("pose", true, q, random).values
    for header, hint in (
        ("q2,q1,q3,x,y,z,qw,qx,qy,qz", "the columns q1 and q2 exchanged"),
        ("q1,q2,q3,y,x,z,qw,qx,qy,qz", "the columns x and y exchanged"),
        ("q1,q2,q3,x,y,z,qz,qw,qx,qy", "with the four numbers in the order qx qy qz qw"),
    ):
        quaternions = [quaternion(R) for R in T[:, :3, :3]]
        rows = np.column_stack([q, T[:, :3, 3], quaternions])
        text = "\n".join(",".join(repr(float(x)) for x in row) for row in rows)
        (tmp_path / "m.csv").write_text(f"{header}\n{text}\n")
        table = read_table(tmp_path / "m.csv", ["q1", "q2", "q3"])
        with pytest.raises(InputError) as caught:
            estimate_checked(nominal, table.measurements(NOISE, 1e-4), table)
        assert hint in str(caught.value)


@pytest.mark.parametrize("mistake", ["position columns", "joint columns", "none"])
@pytest.mark.sweep(but=["position columns", "none"])
def test_a_mistake_is_named_rightly_from_few_poses_or_not_at_all(mistake, tmp_path):
    """The kind of mistake that had the wrong name from 16 poses; ``mistakes_study`` asks for more seeds and arms."""
    assert [outcome("rrr", mistake, count, 3, tmp_path) for count in (8, 16)] == ["right", "right"]


def quaternion(R):
    """The quaternion (w, x, y, z) of a rotation, from the eigenvector of its matrix (Bar-Itzhack)."""
    K = np.array([
        [R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
        [0, R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[0, 2] + R[2, 0]],
        [0, 0, R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2]],
        [0, 0, 0, R[2, 2] - R[0, 0] - R[1, 1]],
    ])  # fmt: skip
    return np.linalg.eigh(K, UPLO="U")[1][:, -1]


def test_values_out_of_reach_and_many_outliers_are_explained(tmp_path):
    spec, random = load_spec("rrr"), np.random.default_rng(1)
    nominal, true = off_the_table(spec, random)
    q = positions(spec, 40, random)
    lines = [f"{a},{b},{c},{1e3 * h}" for (a, b, c), h in zip(q, true.forward(q)[:, 2, 3], strict=True)]
    (tmp_path / "h.csv").write_text("q1,q2,q3,height\n" + "\n".join(lines) + "\n")
    table = read_table(tmp_path / "h.csv", ["q1", "q2", "q3"])
    with pytest.raises(InputError, match="does not reach most of the measured values") as caught:
        estimate_checked(nominal, table.measurements(NOISE, 1e-4), table)
    assert "lengths in mm: write units in the header, as in height [mm]" in str(caught.value)
    T = measure("pose", true, q, random).values
    T[:12, :3, 3] += random.normal(size=(12, 3)) * 0.1
    table = written(tmp_path / "m.csv", q, T)
    with pytest.raises(InputError, match="robust sets 12 of them aside as outliers"):
        estimate_checked(nominal, table.measurements(NOISE, 1e-4), table)
    assert estimate_checked(nominal, table.measurements(NOISE, 1e-4), table, robust=True).outliers == list(range(12))


@pytest.mark.sweep
def test_up_to_half_outliers_are_set_aside_and_more_are_refused_with_their_share(tmp_path):
    """Outliers are off alike, as by a target that slipped; from Huber's weights alone the estimate follows them."""
    spec, random = load_spec("rrr"), np.random.default_rng(2)
    nominal, true = off_the_table(spec, random)
    q = positions(spec, 40, random)
    for count in (19, 24):
        T = measure("pose", true, q, random).values
        T[:count] = T[:count] @ rigid([0.03, -0.02, 0.05, 0, 0.02, 0])
        if count > 20:
            T[:count, :3, 3] += random.normal(size=(count, 3)) * 0.02
        table = written(tmp_path / "m.csv", q, T)
        if count == 19:
            found = estimate_checked(nominal, table.measurements(NOISE, 1e-4), table, robust=True)
            assert found.outliers == list(range(19))
            assert 0.5 < found.chi2_per_dof < 1.5
        else:
            with pytest.raises(InputError, match=r"only 16 of 40 measurements \(40 %\) fit together"):
                estimate_checked(nominal, table.measurements(NOISE, 1e-4), table, robust=True)
