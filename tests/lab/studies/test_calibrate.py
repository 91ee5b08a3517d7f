"""Calibration as a function: from arrays without files, with the numbers and the robot file of the command."""

import numpy as np
import pytest

import rrrgen
from lab.calibrate.virtual import measure, off_the_table, positions
from lab.studies.commands import printed_json
from rrrgen.base.errors import InputError
from rrrgen.lab.calibrate.geometry import rotation_vectors
from rrrgen.lab.calibrate.measurements import table_of_arrays

NAMES = ("q1", "q2", "q3", "q4")


@pytest.fixture(scope="module")
def arrays():
    """Measured poses of a SCARA that is off its table."""
    random = np.random.default_rng(3)
    spec = rrrgen.load_spec("scara")
    _, true = off_the_table(spec, random)
    q = positions(spec, 40, random)
    return {"q": q, "poses": measure("pose", true, q, random).values}


def test_arrays_give_the_numbers_of_the_command(arrays, tmp_path, capsys):
    result = rrrgen.calibrate("scara", arrays, robust=True)
    table = table_of_arrays(arrays, NAMES)
    rows = [",".join(table.names), *(",".join(map(str, row)) for row in table.values)]
    (tmp_path / "measured.csv").write_text("\n".join(rows) + "\n")
    robot = tmp_path / "robot.yaml"
    command = ["calibrate", "scara", "--poses", tmp_path / "measured.csv", "--robust", "-o", robot]
    code, printed = printed_json(capsys, *command)
    assert (code, printed) == (0, result.to_json())
    assert rrrgen.load_spec(robot).rows == rrrgen.loads_spec(result.robot_file()).rows
    result.save(tmp_path / "saved")
    assert (tmp_path / "saved/results/robot.yaml").read_text() == robot.read_text().replace("measured.csv", "arrays")
    assert (tmp_path / "saved/figures/errors.svg").is_file()
    assert repr(result).startswith("40 measurements (pose)")
    assert result["base_x"].unit == "m"


def test_poses_become_quaternions_and_back():
    """Half turns too, whose scalar part is 0."""
    random = np.random.default_rng(0)
    axes = random.normal(size=(20, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    T = np.tile(np.eye(4), (20, 1, 1))
    T[:, :3, :3] = 2 * axes[:, :, None] * axes[:, None] - np.eye(3)
    T[10:, :3, :3] = rotated(random.normal(size=(10, 3)))
    table = table_of_arrays({"q": np.zeros((20, 1)), "poses": T}, ["q1"])
    again = table.measurements(1e-4, 1e-4).values
    turned = again[:, :3, :3] @ np.swapaxes(T[:, :3, :3], 1, 2)
    assert np.abs(rotation_vectors(turned)).max() < 1e-12  # rounding of an eigenvector


def rotated(w):
    from rrrgen.lab.calibrate.geometry import rotation

    return np.array([rotation(each) for each in w])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"q": np.zeros((40, 3))}, r"'q' has the shape \(40, 3\), not \(N, 4\)"),
        ({"poses": np.zeros((40, 3))}, r"'poses' has the shape \(40, 3\), not \(N, 4, 4\)"),
        ({"x": np.zeros(3)}, "the columns have different lengths"),
        ({"colour": np.zeros(40)}, "the column 'colour' is not used"),
    ],
)
def test_arrays_that_are_no_measurements_are_refused(arrays, change, message):
    with pytest.raises(rrrgen.InputError, match=message):
        rrrgen.calibrate("scara", {**arrays, **change})


@pytest.mark.parametrize(
    ("matrix", "fault"),
    [(1.1 * np.eye(3), "misses the unit matrix by 0.21"), (np.diag([1.0, 1.0, -1.0]), "reflection")],
)
def test_poses_without_a_rotation_are_refused(matrix, fault):
    """A scaled rotation was taken for the nearest rotation in silence."""
    T = np.tile(np.eye(4), (20, 1, 1))
    T[:, :3, :3] += 1e-4  # rounded decimals are taken
    assert len(table_of_arrays({"q": np.zeros((20, 1)), "poses": T}, ["q1"]).values) == 20
    T[7, :3, :3] = matrix
    with pytest.raises(InputError, match=f"'poses' has no rotation at index 7: .*{fault}"):
        table_of_arrays({"q": np.zeros((20, 1)), "poses": T}, ["q1"])
