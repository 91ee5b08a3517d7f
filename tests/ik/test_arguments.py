"""Arguments of the inverse kinematics: what has no meaning is refused, not read as something else."""

import numpy as np
import pytest

import rrrgen
from ik.robots import robot
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.robot.file import load_spec
from rrrgen.runtime.inverse_kinematics import load_solver


@pytest.fixture(scope="module")
def puma():
    return load_solver(robot("puma"))


def pose():
    T = np.eye(4)
    T[:3, 3] = [0.3, 0.2, 0.4]
    return T


@pytest.mark.parametrize("sort", ["bogus", "NEAREST", "", None, 1, True])
def test_order_of_rows(puma, sort):
    with pytest.raises(ValueError, match="'branch' or 'nearest'"):
        puma.solve(pose(), sort=sort)
    with pytest.raises(ValueError, match="'branch' or 'nearest'"):
        puma.solve_batch(pose()[None], sort=sort)


@pytest.mark.parametrize("value", [5, 1, 0, 1.0, "yes", None, np.array([True])])
def test_flags_are_booleans(puma, value):
    for call in (
        lambda: puma.solve(pose(), limits=value),
        lambda: puma.solve(pose(), residual=value),
        lambda: puma.closest(pose(), limits=value),
        lambda: puma.solve_batch(pose()[None], limits=value),
    ):
        with pytest.raises(TypeError, match="must be True or False"):
            call()
    assert len(puma.solve(pose(), limits=np.bool_(False))) == 8


@pytest.mark.parametrize("kind", [complex, bool, object, str])
def test_targets_and_references_are_real(puma, kind):
    wrong = pose().astype(kind)
    for call in (puma.solve, puma.closest, lambda T: puma.solve_batch(T[None])):
        with pytest.raises(TypeError, match="must hold real numbers"):
            call(wrong)
    with pytest.raises(TypeError, match="q_ref must hold real numbers"):
        puma.solve(pose(), np.zeros(6).astype(kind))


@pytest.mark.parametrize("row", [(9, 9, 9, 9), (0, 0, 0, 2), (0.1, 0, 0, 1), (0, 0, 0, np.nan)])
@pytest.mark.parametrize("name", ["puma", "planar"])
def test_the_last_row_of_a_pose(puma, row, name):
    """Also where the solver takes only the position out of it."""
    solver = puma if name == "puma" else load_solver(load_spec("planar2r"), backend="numpy")
    good, wrong = pose(), pose()
    wrong[3] = row
    for call in (solver.solve, solver.closest, lambda T: solver.solve_batch(np.stack([good, T]))):
        call(good)
        with pytest.raises(InputError, match="target: the last row of a pose is 0 0 0 1, not"):
            call(wrong)
    assert solver.solve(np.full((4, 4), np.nan)).status == "not finite"


def test_masked_and_ragged_targets(puma):
    with pytest.raises(TypeError, match="masked"):
        puma.solve(np.ma.masked_array(pose(), mask=np.eye(4, dtype=bool)))
    with pytest.raises(ValueError, match="rectangular"):
        puma.solve([[1.0, 0.0], [0.0]])
    assert len(puma.solve(pose().tolist())) == 8
    assert len(puma.solve(pose().astype(np.float32), limits=False)) == 8


def test_redundancy(puma):
    with pytest.raises(DerivationError, match="no redundancy"):
        puma.solve(pose(), redundancy=0.3)
    panda = load_solver(robot("panda"))
    for wrong in (0.3 + 0j, True, "0.3", [0.3, 0.4]):
        with pytest.raises(TypeError, match="redundancy"):
            panda.solve(pose(), redundancy=wrong)
    with pytest.raises(InputError, match=r"one number or of shape \(2,\)"):
        panda.solve_batch(np.stack([pose(), pose()]), redundancy=[0.1, 0.2, 0.3])
    with pytest.raises(TypeError, match="values must hold real numbers"):
        panda.sweep(pose(), np.array([1j]))


@pytest.mark.parametrize("name", ["ur5", "scara", "panda"])
def test_a_float_model_solves_the_poses_that_it_computes(name):
    """Their rotations are off by 1e-7, and an arm of four joints cannot meet a rounded pose to the last bit."""
    model = rrrgen.compile(name, real="float")
    q = np.linspace(0.3, 0.9, model.n)
    redundancy = model.ik.parameter(q) if name == "panda" else None
    T = model.forward_kinematics(q)
    result = model.inverse_kinematics(T, limits=False, redundancy=redundancy)
    assert result.q.dtype == np.float32
    apart = np.abs(result.q - q)
    assert np.minimum(apart, np.abs(apart - 2 * np.pi)).max(axis=1).min() < 1e-4
    batch = model.inverse_kinematics(np.stack([T, T]), limits=False, redundancy=redundancy)
    assert batch.q.dtype == np.float32
    np.testing.assert_array_equal(batch.q[1, : batch.counts[1]], result.q)
