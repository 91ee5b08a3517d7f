"""Structural identifiability against published counts and against exact statements about single parameters."""

import numpy as np
import pytest

from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.estimate.identifiability import combination, fix_standard, structure_of, structure_of_matrix
from rrrgen.lab.identify.parameters import CoupledDrive, DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.robot.spec import standard_names
from rrrgen.runtime.regressor_columns import drive_columns
from samples.stand_in import HALF_PI, RRR_ROWS, TX40_ROWS, NumericModel, Row

PUMA = [
    Row(HALF_PI, 0, 0),
    Row(0, 0.4318, 0),
    Row(-HALF_PI, 0.0203, 0.15005),
    Row(HALF_PI, 0, 0.4318),
    Row(-HALF_PI, 0, 0),
    Row(0, 0, 0),
]
GENERIC = [Row(0.3 + 0.2 * i, 0.1 + 0.05 * i, 0.2 - 0.03 * i) for i in range(6)]
PLANAR2, PLANAR3 = ([Row(0, 0.4, 0)] * 2, [Row(0, 0.4, 0)] * 3)
PPP = [Row(-HALF_PI, 0, 0, 0, "prismatic"), Row(HALF_PI, 0, 0, HALF_PI, "prismatic"), Row(0, 0, 0, 0, "prismatic")]
STANFORD = [
    Row(-HALF_PI, 0, 0.4),
    Row(HALF_PI, 0, 0.15),
    Row(0, 0, 0, 0, "prismatic"),
    Row(-HALF_PI, 0, 0),
    Row(HALF_PI, 0, 0),
    Row(0, 0, 0.2),
]
IN_PLANE, DOWN = (0.0, -9.81, 0.0), (0.0, 0.0, -9.81)

# rigid, + drive inertia, + viscous and Coulomb friction, + offset: identification.md, section 4
COUNTS = [
    ("2R planar vertical", PLANAR2, IN_PLANE, (6, 7, 11, 13)),
    ("2R planar horizontal", PLANAR2, DOWN, (4, 5, 9, 11)),
    ("3R planar vertical", PLANAR3, IN_PLANE, (9, 11, 17, 20)),
    ("RRR of the chapter", RRR_ROWS, DOWN, (15, 16, 22, 25)),
    ("RRR without gravity", RRR_ROWS, (0.0, 0.0, 0.0), (13, 14, 20, 23)),
    ("RRR on a horizontal base", RRR_ROWS, IN_PLANE, (17, 18, 24, 27)),
    ("Puma 560", PUMA, DOWN, (36, 40, 52, 58)),
    ("generic 6R", GENERIC, DOWN, (36, 41, 53, 59)),
    ("Stanford arm", STANFORD, DOWN, (33, 37, 49, 55)),
    # axes at right angles, the first one vertical: three sums of masses, and only the vertical drive's inertia apart
    ("Cartesian PPP", PPP, DOWN, (3, 4, 10, 12)),
]


@pytest.mark.parametrize(("rows", "gravity", "counts"), [row[1:] for row in COUNTS], ids=[row[0] for row in COUNTS])
def test_counts_of_identifiable_parameters(rows, gravity, counts):
    model = NumericModel(list(rows), gravity=gravity)
    kinds = ([], ["inertia"], ["inertia", "viscous", "coulomb"], ["inertia", "viscous", "coulomb", "offset"])
    found = []
    for chosen in kinds:
        regressor = FullRegressor(model, DriveTerms.everywhere(model.n, *chosen))
        structure = structure_of(regressor, regressor.names, model.n)
        found.append(structure.rank)
        if structure.rank < len(structure.singular):
            # the decision is clear-cut: nothing lies near the tolerance
            assert structure.singular[structure.rank] < 1e-11 * structure.singular[structure.rank - 1]
    assert tuple(found) == counts


@pytest.mark.parametrize("seed", range(3))
def test_tx40_has_61_identifiable_parameters(seed):
    model = NumericModel(TX40_ROWS, "modified")
    wrist = CoupledDrive("m6", (0, 0, 0, 0, 1, 1))
    regressor = FullRegressor(
        model, DriveTerms.everywhere(6, "inertia", "viscous", "coulomb", "offset", coupled=[wrist])
    )
    structure = structure_of(regressor, regressor.names, 6, seed)
    assert (len(regressor.names), structure.rank) == (63, 61)
    assert structure.singular[61] < 1e-12 * structure.singular[60]
    assert {structure.all_names[j] for j in structure.dependent} == {"Ia1", "Ia2"}


def test_regrouping_explains_every_column():
    model = NumericModel(PUMA)
    structure = structure_of(model.standard_regressor, standard_names(6), 6)
    rng = np.random.default_rng(3)
    q, dq, ddq = (rng.normal(size=(40, 6)) for _ in range(3))
    W = model.standard_regressor(q, dq, ddq).reshape(-1, 60)
    np.testing.assert_allclose(W[:, list(structure.kept)] @ structure.G, W, atol=1e-10 * np.abs(W).max())


def test_the_decision_does_not_depend_on_units():
    rng = np.random.default_rng(0)
    W = rng.normal(size=(100, 6))
    W[:, 4] = W[:, 0] - 2 * W[:, 2]
    for scale in (np.ones(6), 10.0 ** np.array([-5, 3, -1, 1, -3, 5])):
        found = structure_of_matrix(W * scale, list("abcdef"))
        assert found.kept == (0, 1, 2, 3, 5)
        np.testing.assert_allclose(found.G[:, 4], np.array([1, 0, -2, 0, 0]) * scale[4] / scale[[0, 1, 2, 3, 5]])


def test_a_rank_between_round_off_and_signal_is_refused():
    rng = np.random.default_rng(0)
    U = np.linalg.qr(rng.normal(size=(50, 4)))[0]
    V = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    W = U @ np.diag([1.0, 1.0, 1.0, 2e-9]) @ V
    outcomes = [_rank_or_refusal(W, tolerance) for tolerance in np.geomspace(1e-10, 1e-7, 100)]
    # the singular value and the sticking-out column differ by a factor, between which no decision is sound
    assert outcomes[0] == 4
    assert outcomes[-1] == 3
    assert "refused" in outcomes


def _rank_or_refusal(W, tolerance):
    try:
        return structure_of_matrix(W, list("abcd"), tolerance).rank
    except DerivationError:
        return "refused"


def test_words_for_what_cannot_be_told():
    model = NumericModel(RRR_ROWS)
    words = structure_of(model.standard_regressor, standard_names(3), 3).in_words()
    assert "m1 has no effect on any joint torque" in words
    assert sum("no effect" in word for word in words) == 9  # of link 1, as in the chapter
    assert sum("is not identifiable alone, only within" in word for word in words) == 30 - 15 - 9


def test_balanced_links_leave_thirteen_parameters():
    """y2 = y3 = 0 makes p4 = p15 = 0 and nothing else (errata 12)."""
    model = NumericModel(RRR_ROWS)
    found = fix_standard(model.base_projection, {"my2": 0.0, "my3": 0.0})
    assert len(found.kept) == 13
    assert {model.base_parameter_names[i] for i in found.fixed} == {"my2", "my3"}
    np.testing.assert_array_equal(found.beta_0, 0.0)


def test_fixed_standard_parameters_restrict_the_base_parameters():
    model = NumericModel(RRR_ROWS)
    K = model.base_projection
    rng = np.random.default_rng(1)
    phi = rng.normal(size=30)
    names = standard_names(3)
    known = {name: phi[names.index(name)] for name in ("m3", "mx3", "my3", "mz3", "Izz2", "Iyy2", "mx2")}
    found = fix_standard(K, known)
    beta = K @ phi
    np.testing.assert_allclose(found.B @ beta[list(found.kept)] + found.beta_0, beta, atol=1e-12)
    assert len(found.kept) == np.linalg.matrix_rank(K[:, [i for i, n in enumerate(names) if n not in known]])
    with pytest.raises(InputError, match="no standard parameter 'my9'"):
        fix_standard(K, {"my9": 0.0})


def test_drive_columns_of_a_coupled_drive():
    """Power of a drive that turns with s = w q: w'f dq = f ds."""
    drive = CoupledDrive("m", (0.0, 2.0, -1.0))
    columns = DriveTerms(coupled=(drive,)).columns(3)
    rng = np.random.default_rng(2)
    dq, ddq = rng.normal(size=(5, 3)), rng.normal(size=(5, 3))
    W = drive_columns(columns, dq, ddq)
    ds, dds = dq @ drive.direction, ddq @ drive.direction
    power = np.einsum("knp,kn->kp", W, dq)
    np.testing.assert_allclose(power, np.column_stack([dds * ds, ds**2, np.abs(ds)]), rtol=1e-12)
    assert [c.name for c in columns] == ["Ia_m", "fv_m", "fc_m"]
    np.testing.assert_array_equal(drive_columns(columns, 0 * dq, 0 * ddq), 0.0)


def test_combinations_are_written_as_a_control_engineer_would():
    assert combination(["p1", "p2", "p3"], np.array([1.0, -0.5, 0.0])) == "p1 - 0.5*p2"
    assert combination(["a + b", "c"], np.array([-2.0, 1.0])) == "-2*(a + b) + c"
    assert combination(["a"], np.array([0.0])) == "0"
