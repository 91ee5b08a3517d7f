"""What is printed is the model that is written: its values, deviations that hold, units, names and weak directions."""

import csv

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.cli.main import cli
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.estimate.identifiability import collinear
from rrrgen.lab.estimate.regression import (
    HUBER,
    correlated_covariance,
    least_squares,
    robust_least_squares,
    weighted_least_squares,
)
from rrrgen.lab.estimate.statistics import correlation_lags, residual_whiteness
from rrrgen.lab.estimate.tsqr import Rows, factor_rows
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.robot.file import dumps
from samples.recordings import fourier_motion, write_log

TERMS = DriveTerms.everywhere(2, "viscous", "coulomb")
FRICTION = np.array([0.8, 0.4, 1.5, 0.0])  # the last joint has no Coulomb friction: its estimate meets the bound
LOGGED = Processing("logged", decimate=1)
REPEATS = 30


def coloured(rng, shape, rho):
    """AR(1) noise of unit variance along axis 0."""
    noise = rng.normal(size=shape)
    for k in range(1, len(noise)):
        noise[k] = rho * noise[k - 1] + np.sqrt(1 - rho**2) * noise[k]
    return noise


@pytest.fixture(scope="module")
def arm():
    return rrrgen.compile("planar2r")


def experiment(arm, seed, noise, rho=0.0, samples=1200):
    t = 0.01 * np.arange(samples)
    q, dq, ddq = fourier_motion(t, 2, 5, base=1 / 6)
    tau = FullRegressor(arm, TERMS)(q, dq, ddq) @ np.concatenate([arm.beta, FRICTION])
    tau = tau + noise * coloured(np.random.default_rng(seed), tau.shape, rho)
    return Log(("q1", "q2"), t, q, tau, dq=dq, ddq=ddq, period=0.01)


@pytest.mark.parametrize("method", ["weighted", pytest.param("robust", marks=pytest.mark.sweep)])
def test_deviations_of_the_delivered_model_are_those_of_repeated_experiments(arm, method):
    """Coloured noise, links off the prior by nothing and friction at its bound: spread and reports agree."""
    options = Options(method=method, terms=TERMS, poses=2)
    found = [identify(arm, [experiment(arm, s, 0.3, rho=0.8)], LOGGED, options) for s in range(REPEATS)]
    truth = found[0].structure.G @ np.concatenate([arm.beta, FRICTION])
    x = np.array([each.delivered.x for each in found])
    std = np.array([each.delivered.std for each in found])
    assert found[0].delivered.origin == "physically consistent"
    inside = np.abs(x - truth) <= 2.0 * std
    bounded = list(found[0].names).index("fc2")
    free = np.arange(len(truth)) != bounded
    # two deviations hold 95 % of a normal distribution; 30 repeats tell a share to 1.4 % in all
    assert np.mean(inside[:, free]) > 0.87  # deviations for white residuals hold half
    held = np.array([each.delivered.at_bound[bounded] for each in found])
    assert 0.2 < np.mean(held) < 0.8  # half of the errors would be below zero
    assert np.all(x[:, bounded] >= 0.0)
    assert not np.any([each.delivered.at_bound[free] for each in found])


def test_consistent_deviations_are_not_larger_than_unconstrained_ones(arm):
    found = identify(arm, [experiment(arm, 1, 0.3)], LOGGED, Options(terms=TERMS, poses=2))
    assert np.all(found.delivered.std <= 1.02 * found.estimate.std)
    table = dict(zip(found.names, found.delivered.x, strict=True))
    theta = dict(zip((c.name for c in found.columns), found.consistent.theta, strict=True))
    assert table["fv1"] == pytest.approx(theta["fv1"], rel=1e-12)


def test_without_the_consistent_estimate_the_unconstrained_one_is_delivered(arm):
    found = identify(arm, [experiment(arm, 1, 0.3)], LOGGED, Options(terms=TERMS, poses=2, consistent=False))
    assert found.delivered.origin == "weighted"
    np.testing.assert_array_equal(found.delivered.x, found.estimate.x)


def test_a_robust_model_is_delivered_robust(arm):
    """Outliers that pull plain least squares away must not come back by the consistent estimate."""
    log = experiment(arm, 3, 0.1)
    hit = np.random.default_rng(0).random(log.tau.shape) < 0.05
    log.tau[hit] += 30.0
    errors = {}
    for method in ("weighted", "robust"):
        found = identify(arm, [log], LOGGED, Options(method=method, terms=TERMS, poses=2))
        truth = found.structure.G @ np.concatenate([arm.beta, FRICTION])
        errors[method] = np.max(np.abs(found.delivered.x - truth))
    assert errors["robust"] < 0.2 * errors["weighted"]


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("rho", [0.0, 0.9])
@pytest.mark.sweep(but=["0.9-True", "0.0-False"])
def test_deviations_allow_for_coloured_residuals(robust, rho):
    """Regressors as slow as motions are, noise of correlation rho: intervals of 95 % hold the truth nearly so often."""
    t = 0.01 * np.arange(1500)
    W = np.stack([np.sin(0.7 * t), np.cos(1.9 * t), np.sign(np.sin(0.7 * t))], axis=-1)[:, None, :]
    truth, names = np.array([2.0, -1.0, 0.5]), ("a", "b", "c")
    inside = []
    for seed in range(100):
        tau = W @ truth + coloured(np.random.default_rng(seed), (len(t), 1), rho)
        rows = Rows(t, W, tau, np.ones(tau.shape, bool), np.zeros(len(t), np.int64))
        estimate = weighted_least_squares(factor_rows(rows), names)
        if robust:
            estimate = robust_least_squares(lambda rows=rows: [rows], names, estimate)
        lags = max(correlation_lags(w) for w in residual_whiteness([rows], estimate.x))
        limit = HUBER if robust else None
        covariance = correlated_covariance([rows], estimate, lags, lambda x: x, np.eye(3), limit)
        inside.append(np.abs(estimate.x - truth) <= 1.96 * np.sqrt(np.diag(covariance)))
    # white deviations hold 95 % where rho is 0, and a third to a half of it where rho is 0.9
    assert 0.87 < np.mean(inside) <= 1.0


def test_hardly_determined_combinations_are_named():
    rng = np.random.default_rng(0)
    W = rng.normal(size=(400, 1, 3))
    W[:, 0, 2] = 2.0 * W[:, 0, 0] + 1e-2 * rng.normal(size=400)
    tau = W @ np.array([1.0, 2.0, 3.0]) + 0.1 * rng.normal(size=(400, 1))
    rows = Rows(np.arange(400.0), W, tau, np.ones((400, 1), bool), np.zeros(400, np.int64))
    factors = factor_rows(rows)
    (sentence,) = collinear(factors, least_squares(factors, ("a", "b", "c")))
    assert sentence.startswith(("a - 0.5*c", "a - 0.49*c", "a - 0.51*c")) or "a" in sentence.split(" = ")[0]
    assert "b" not in sentence.split(" = ")[0]
    assert "condition index" in sentence
    sound = rows.W.copy()
    sound[:, 0, 2] = rng.normal(size=400)
    factors = factor_rows(Rows(rows.t, sound, tau, rows.use, rows.segment))
    assert collinear(factors, least_squares(factors, ("a", "b", "c"))) == ()


def test_the_table_explains_itself(arm, tmp_path):
    log = experiment(arm, 2, 0.3)
    write_log(tmp_path / "log.csv", log)
    robot = tmp_path / "arm.yaml"
    text = dumps(arm.spec)
    robot.write_text(text.replace("    theta: 0\n", "    theta: 0\n    friction: {viscous: 0, coulomb: 0}\n"))
    out = tmp_path / "found"
    arguments = ["identify", robot, "--log", tmp_path / "log.csv", "--method", "kalman", "--essential", "-o", out]
    result = CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False)
    header = next(line for line in result.stdout.splitlines() if "parameter" in line and "std" in line)
    assert header.split() == ["parameter", "unit", "value", "std", "unconstrained", "std", "pull"]
    assert "fv1 N m s/rad" in " ".join(result.stdout.split())
    assert "value: physically consistent estimate, the one in robot.yaml" in result.stdout
    assert "delta method" in result.stdout
    assert "names: fv: viscous friction" in result.stdout
    assert "essential parameters: " in result.stdout
    with (out / "results" / "parameters.csv").open() as file:
        rows = {row["parameter"]: row for row in csv.DictReader(file)}
    written = rrrgen.load_spec(out / "results" / "robot.yaml")
    assert float(rows["fv1"]["value"]) == pytest.approx(written.joints[0].friction.viscous, rel=1e-12)
    assert rows["fv1"]["unit"] == "N m s/rad"
    assert rows["fv1"]["unconstrained"] != rows["fv1"]["value"]
