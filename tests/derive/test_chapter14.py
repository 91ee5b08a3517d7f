"""The general route gives the printed model of the case study, entry by entry and exactly: (14.43)-(14.47)."""

from __future__ import annotations

from dataclasses import replace

import pytest
import sympy as sp

from derive.exact import vanishes
from oracles import chapter14
from rrrgen.derive import derive_model
from rrrgen.derive.closed_forms import closed_form
from rrrgen.robot.file import load_spec
from rrrgen.robot.spec import parameter_symbol

N = 3
A2, A3, D1, D2, D3 = (parameter_symbol(name) for name in ("a2", "a3", "d1", "d2", "d3"))
G = sp.Rational(981, 100)  # the gravity of the bundled file
Q, DQ, DDQ = (
    [sp.Symbol(f"{kind}{i}", real=True) for i in (1, 2, 3)] for kind in ("q", "dq", "ddq")
)  # the names closed forms use
P = [sp.Symbol(f"p{k}", real=True) for k in range(1, 16)]


@pytest.fixture(scope="module")
def rrr():
    """The bundled robot with the user's basis (14.46)."""
    return derive_model(load_spec("rrr"))


@pytest.fixture(scope="module")
def own():
    """The same robot with the compiler's own basis."""
    return derive_model(replace(load_spec("rrr"), basis=None))


def printed_regressor(dq=DQ, ddq=DDQ, g=G):
    return sp.Matrix(chapter14.regressor_1447(Q, dq, ddq, a2=A2, g=g, xp=sp))


def printed_torque(dq, ddq, g):
    return printed_regressor(dq, ddq, g) * sp.Matrix(P)


def test_forward_kinematics_equals_1443_and_1444(rrr):
    T = closed_form(rrr.derivation, "forward_kinematics")
    printed = sp.eye(4)
    printed[:3, :3] = sp.Matrix(chapter14.orientation_1443(Q, xp=sp))
    printed[:3, 3] = sp.Matrix(chapter14.fk_1444(Q, A2, A3, D1, D2, D3, xp=sp))
    assert T.shape == (4, 4)
    for r in range(4):
        for c in range(4):
            assert vanishes(T[r, c] - printed[r, c]), (r, c)


def test_the_printed_orientation_is_the_text_itself(rrr):
    """Not only equal: collected over parallel axes as printed, with q2 + q3 and nothing expanded."""
    T = closed_form(rrr.derivation, "forward_kinematics")
    assert T[0, 0] == sp.cos(Q[0]) * sp.cos(Q[1] + Q[2])
    assert T[0, 2] == sp.sin(Q[0])
    assert T[2, 1] == sp.cos(Q[1] + Q[2])
    assert T[2, 3] == A2 * sp.sin(Q[1]) + A3 * sp.sin(Q[1] + Q[2]) + D1


def test_regressor_with_the_users_basis_equals_1447(rrr):
    Y = closed_form(rrr.derivation, "regressor")
    printed = printed_regressor()
    assert Y.shape == printed.shape == (N, 15)
    for r in range(N):
        for c in range(15):
            assert vanishes(Y[r, c] - printed[r, c]), (r + 1, c + 1)


def test_the_thirteen_zeros_of_1447(rrr):
    Y = closed_form(rrr.derivation, "regressor")
    zeros = {(r + 1, c + 1) for r in range(N) for c in range(15) if Y[r, c] == 0}
    first = {(1, k) for k in (12, 13, 14, 15)}
    assert zeros == first | {(2, 7)} | {(3, k) for k in (1, 2, 7, 10, 11, 12, 14, 15)}


def test_mass_matrix_equals_the_one_of_1447(rrr):
    M = closed_form(rrr.derivation, "mass_matrix")
    for k in range(N):
        column = printed_torque([0] * N, [int(i == k) for i in range(N)], 0)
        for i in range(N):
            assert vanishes(M[i, k] - column[i]), (i, k)


def test_gravity_and_velocity_torques_equal_those_of_1447(rrr):
    printed = {
        "coriolis": printed_torque(DQ, [0] * N, 0),
        "gravity": printed_torque([0] * N, [0] * N, G),
        "bias": printed_torque(DQ, [0] * N, G),
        "inverse_dynamics": printed_torque(DQ, DDQ, G),
    }
    for function, torque in printed.items():
        form = closed_form(rrr.derivation, function)
        for i in range(N):
            assert vanishes(form[i] - torque[i]), (function, i)


def test_coriolis_matrix_belongs_to_1447(rrr):
    """C dq is the printed velocity torque, and C the matrix of the Christoffel symbols of the printed M."""
    C = closed_form(rrr.derivation, "coriolis_matrix").matrix()
    velocity_torque = printed_torque(DQ, [0] * N, 0)
    for value in C * sp.Matrix(DQ) - velocity_torque:
        assert vanishes(value)
    M = sp.Matrix(N, N, lambda i, k: printed_torque([0] * N, [int(j == k) for j in range(N)], 0)[i])
    for i in range(N):
        for j in range(N):
            christoffel = sum(
                (M[i, j].diff(Q[k]) + M[i, k].diff(Q[j]) - M[j, k].diff(Q[i])) * DQ[k] / 2 for k in range(N)
            )
            assert vanishes(C[i, j] - christoffel), (i, j)


def test_energy_belongs_to_1447(rrr):
    kinetic, potential = (closed_form(rrr.derivation, f"energy.{kind}")[()] for kind in ("kinetic", "potential"))
    M = sp.Matrix(N, N, lambda i, k: printed_torque([0] * N, [int(j == k) for j in range(N)], 0)[i])
    assert vanishes(kinetic - (sp.Matrix([DQ]) * M * sp.Matrix(DQ))[0] / 2)
    gravity = printed_torque([0] * N, [0] * N, G)
    for i in range(N):
        assert vanishes(potential.diff(Q[i]) - gravity[i])


def chapter_links():
    """Symbols of three links in the chapter's names: mass, centre of mass, inertia about the frame's origin."""
    return [{key: sp.Symbol(f"{key}{i}", real=True) for key in chapter14.LINK_KEYS} for i in (1, 2, 3)]


def in_chapter_symbols(expression: sp.Expr) -> sp.Expr:
    """Standard parameters (first moments, tensor signs) as centres of mass and positive products."""
    values = {}
    for i, link in enumerate(chapter_links(), start=1):
        for axis in "xyz":
            values[sp.Symbol(f"m{axis}{i}", real=True)] = link["m"] * link[axis]
        for key in ("Ixy", "Ixz", "Iyz"):
            values[link[key]] = -link[key]
    return expression.xreplace(values)


def test_the_users_basis_is_1446(rrr):
    """The chapter's products are positive; what the compiler prints is the tensor's."""
    links = [{k: -v if k in ("Ixy", "Ixz", "Iyz") else v for k, v in link.items()} for link in chapter_links()]
    printed = chapter14.base_parameters_1446(links, A2, A3, D2, D3)
    assert [p.name for p in rrr.base_parameters] == [str(p) for p in P]
    for parameter, expression in zip(rrr.base_parameters, printed, strict=True):
        assert sp.expand(parameter.expression - expression) == 0, parameter.name


def test_nominal_base_parameters_are_1446_in_numbers(rrr):
    links = []
    for link in load_spec("rrr").links:
        xx, yy, zz, xy, xz, yz = link.inertia_about_origin()
        values = (link.mass, *link.com, xx, yy, zz, -xy, -xz, -yz)
        links.append(dict(zip(chapter14.LINK_KEYS, values, strict=True)))
    exact = [sp.Rational(text) for text in ("0.2", "0.415", "0.169", "0.09")]
    printed = chapter14.base_parameters_1446(links, *exact)
    assert [sp.Rational(v.numerator, v.denominator) for v in rrr.beta_nominal] == printed


def test_without_a_basis_the_torques_are_the_same(own):
    """The compiler's own regressor times its own parameters, against (14.47) times (14.46), in all link symbols."""
    Y = closed_form(own.derivation, "regressor")
    own_parameters = [in_chapter_symbols(p.expression) for p in own.base_parameters]
    printed = printed_regressor()
    parameters = chapter14.base_parameters_1446(chapter_links(), A2, A3, D2, D3)
    assert len(own_parameters) == 15
    for i in range(N):
        own_torque = sum(Y[i, k] * own_parameters[k] for k in range(15))
        printed_sum = sum(printed[i, k] * parameters[k] for k in range(15))
        assert vanishes(own_torque - printed_sum), i


def test_a_wrong_sign_would_be_seen(rrr):
    """The comparison itself: every entry of the printed regressor, negated, is noticed."""
    Y = closed_form(rrr.derivation, "regressor")
    printed = printed_regressor()
    for r in range(N):
        for c in range(15):
            assert vanishes(Y[r, c] + printed[r, c]) == (printed[r, c] == 0)
