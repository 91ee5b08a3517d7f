"""Study of what recordings hide, on virtual arms with known truth.

    PYTHONPATH=tests python tests/lab/identify/recordings_study.py NAME

It prints a line per case: coverage of the 95 % intervals of the parameters (``coverage``), what the diagnosis says of
single mistakes (``detection``) and of two at once (``pairs``), what the bands of held-out torques hold where the model
errs (``bands``), each on sets with fresh motion and noise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import click
import numpy as np

import rrrgen
from rrrgen.base.arrays import Array
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.estimate.statistics import confidence_factor
from rrrgen.lab.identify.diagnosis.causes import Wording
from rrrgen.lab.identify.diagnosis.hypotheses import Comparison
from rrrgen.lab.identify.diagnosis.trial_fits import AllTerms, linear_stand_ins, sample_of
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.identification import Identification, Options, identify
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.lab.identify.scores import BAND
from rrrgen.robot.spec import standard_parameters
from samples.recordings import fourier_motion

PERIOD = 0.01
PROCESSING = Processing("butterworth", cutoff=10.0, decimate=5)
NOISES = {"white": 0.0, ".1 s": 0.1, ".5 s": 0.5}


def model_of(robot: str) -> Any:
    """The compiled robot, evaluated with NumPy."""
    return rrrgen.compile(robot, backend="numpy")


def noise_of(shape: tuple[int, int], time: float, random: np.random.Generator) -> Array:
    """Noise of unit variance, white or with the correlation ``time`` (s) of a first-order process."""
    from scipy.signal import lfilter

    white = random.normal(size=shape)
    if time == 0.0:
        return white
    a = np.exp(-PERIOD / time)
    white[0] /= np.sqrt(1.0 - a * a)
    return np.asarray(lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], white, axis=0))


@dataclass(frozen=True)
class Case:
    """A set: the recording, the regressor with all drive terms and the true values ``theta`` (p,) of its columns."""

    model: Any
    log: Log
    regressor: FullRegressor
    theta: Array


def case(
    model: Any, seed: int, seconds: float, correlation: float, noise: float = 0.05, possible: bool = False
) -> Case:
    """An arm on five harmonics of .1 Hz, torque noise of ``noise`` times the RMS torque of the joint.

    Its base parameters differ from those of the robot file by up to 30 %; if ``possible``, the links do, each as a
    whole, so that they stay physical.
    """
    random = np.random.default_rng([seed, 5])
    n = model.n
    t = np.arange(round(seconds / PERIOD)) * PERIOD
    q, dq, ddq = fourier_motion(t, n, seed, base=0.1, harmonics=5, size=0.5)
    regressor = FullRegressor(model, DriveTerms.everywhere(n, "inertia", "viscous", "coulomb", "offset"))
    if possible:
        phi = np.array([standard_parameters(link) for link in model.spec.links], float)
        links = model.base_projection @ (random.uniform(0.7, 1.3, (len(phi), 1)) * phi).ravel()
    else:
        links = np.asarray(model.beta) * random.uniform(0.7, 1.3, len(model.beta))
    size = np.sqrt(np.mean((np.asarray(model.regressor(q, dq, ddq)) @ links) ** 2, axis=0))
    size = np.maximum(size, 0.02 * np.max(size))
    drives = [random.uniform(0.02, 0.1, n) * size for _ in range(4)]
    drives[0] = drives[0] / np.sqrt(np.mean(ddq**2, axis=0))
    theta = np.concatenate([links, *drives])
    exact = regressor(q, dq, ddq) @ theta
    tau = exact + noise * np.sqrt(np.mean(exact**2, axis=0)) * noise_of(q.shape, correlation, random)
    names = tuple(joint.name for joint in model.spec.joints)
    return Case(model, Log(names, t, np.round(q, 7), tau, period=PERIOD), regressor, theta)


def identified(given: Case, **options: Any) -> Identification:
    """The estimate of a set, with all drive terms."""
    plain = Options(terms=given.regressor.terms, consistent=False, poses=2)
    return identify(given.model, [given.log], PROCESSING, replace(plain, **options))


def coverage(sets: int, robot: str, first: int) -> Iterator[str]:
    """Share of the 95 % intervals that hold the true parameter, least share of a parameter, RMS of error over std.

    Of the unconstrained estimate, of the same with the deviations of white residuals, and of the physically consistent
    estimate, on the same recordings of arms that are physically possible.
    """
    model = model_of(robot)
    for seconds in (30.0, 150.0):
        for name, correlation in NOISES.items():
            z: dict[str, list[Array]] = {"unconstrained": [], "white": [], "consistent": []}
            for seed in range(first, first + sets):
                given = case(model, seed, seconds, correlation, possible=True)
                found = identified(given, consistent=True)
                assert found.parametrisation is not None
                true = found.parametrisation.contract(given.theta)
                z["unconstrained"].append((found.estimate.x - true) / found.estimate.std)
                z["white"].append((found.estimate.x - true) / found.iid_std)
                std = np.where(found.delivered.at_bound, np.nan, found.delivered.std)  # no interval is given there
                z["consistent"].append((found.delivered.x - true) / std)
            half = confidence_factor(0.95, found.estimate.freedom)
            for what, each in z.items():
                size = np.abs(np.array(each))
                there, inside = np.isfinite(size), size < half
                worst = np.min(np.sum(inside, axis=0) / np.maximum(1, np.sum(there, axis=0)))
                yield (
                    f"{robot} {seconds:.0f} s, {name} noise, {what}: {100 * np.sum(inside) / np.sum(there):.1f} % of "
                    f"{np.sum(there)} intervals, worst parameter {100 * worst:.0f} %, "
                    f"rms z {np.sqrt(np.nanmean(np.square(size))):.2f}"
                )


def unmodelled(given: Case, seed: int) -> Case:
    """The set with effects that no column describes: two ripples over position and Stribeck friction at every joint.

    Each has 1 to 3 % of the RMS torque of its joint; friction falls within 0.05 to 0.2 of the RMS speed.
    """
    random = np.random.default_rng([seed, 6])
    log = given.log
    tau, dq = np.array(log.tau), np.gradient(log.q, PERIOD, axis=0)
    for j, size in enumerate(np.sqrt(np.mean(tau**2, axis=0))):
        for order in random.integers(4, 60, 2):
            tau[:, j] += size * random.uniform(0.01, 0.03) * np.sin(order * log.q[:, j] + random.uniform(0.0, 6.3))
        slow = random.uniform(0.05, 0.2) * np.sqrt(np.mean(dq[:, j] ** 2))
        tau[:, j] += size * random.uniform(0.01, 0.03) * np.sign(dq[:, j]) * np.exp(-((dq[:, j] / slow) ** 2))
    return replace(given, log=replace(log, tau=tau))


def bands(sets: int, robot: str, first: int) -> Iterator[str]:
    """Share of held-out torques inside their 95 % band where the model errs, over all rows and at the worst joint."""
    model = model_of(robot)
    for seconds in (30.0, 150.0):
        for split in ("first:0.6", "blocks:2"):
            for consistent in (False, True):
                shares, worst, width = [], [], []
                for seed in range(first, first + sets):
                    given = unmodelled(case(model, seed, seconds, 0.1, noise=0.01), seed)
                    found = identified(given, split=Split.parse(split), consistent=consistent)
                    covered = found.band.coverage(found.held_out_blocks)
                    assert covered is not None
                    shares.append(covered.share)
                    worst.append(min(covered.joints))
                    width.append(float(np.mean(found.band.factor)) / BAND)
                yield (
                    f"{robot} {seconds:.0f} s, {split}, {'consistent' if consistent else 'unconstrained'}: band holds "
                    f"{100 * np.mean(shares):.1f} % of the rows (least set {100 * np.min(shares):.1f}), worst joint "
                    f"{100 * np.mean(worst):.1f} % (least set {100 * np.min(worst):.1f}), width {np.mean(width):.2f}"
                )


def comparison(given: Case) -> Comparison:
    """The comparison of hypotheses for a set, with all drive terms in the model."""
    regressor = AllTerms(given.model, linear_stand_ins(given.regressor.columns))
    sample = sample_of(given.log, PROCESSING)
    assert sample is not None
    return Comparison(regressor, sample, range(len(regressor.names)))


def words_of(given: Case) -> Wording:
    """The wording of causes for a set."""
    joints = given.model.spec.joints
    return Wording(tuple(j.name for j in joints), tuple(j.is_revolute for j in joints))


MISTAKES = (
    *("gain 3 2", "gain 3 1.1", "zero 2 90", "zero 2 5", "delay 0 30", "delay 0 5", "delay 2 10", "tilt 0 2"),
    *("drift 0 -35", "drift 2 -35", "zero 4 20", "zero 3 5", "gain 5 1.2", "gain 2 0.8"),
)


def verdict(given: Case, mistake: str) -> tuple[str, float, str]:
    """Whether a mistake is named, possible, silent or wrong, its gain, and the first cause in words.

    Drift of one joint where that of all was made is named in part.
    """
    found = comparison(given)
    findings = found.findings()
    if not findings:
        return "silent", 0.0, ""
    first = findings[0]
    kind, joint, _ = mistake.split()
    hypothesis = first.outcome.hypothesis
    right = hypothesis.subject == kind and (kind == "tilt" or hypothesis.joint == int(joint) - 1)
    part = not right and hypothesis.subject == kind == "drift" and joint == "0"
    cause = found.cause(first, words_of(given))
    text = f"{cause.cause}: {cause.evidence[0]}"
    what = "named" if first.named else "possible"
    what = what if right else f"{what} in part" if part else f"WRONG {what}"
    more = "" if len(findings) == 1 else f" (+ {len(findings) - 1})"
    return what, first.outcome.gain, text + more


def detection(sets: int, robot: str, first: int) -> Iterator[str]:
    """What is said of single mistakes, and of sound sets."""
    model = model_of(robot)
    counts: dict[str, int] = {}
    for seed in range(first, first + sets):
        given = case(model, 100 + seed, 30.0, 0.1, noise=0.01)
        findings = comparison(given).findings()
        counts["false alarms"] = counts.get("false alarms", 0) + bool(findings)
        if findings:
            yield f"sound set {seed}: {findings[0].outcome.hypothesis} {findings[0].outcome.gain:.3f}"
        for mistake in (each for each in MISTAKES if int(each.split()[1]) <= model.n):
            what, gain, text = verdict(mistaken(given, mistake), mistake)
            counts[what] = counts.get(what, 0) + 1
            yield f"{mistake}: {what}, gain {gain:.2f}; {text}"
    yield f"{robot}: {counts}"


PAIRS = (
    *(("gain 3 2", "zero 2 90"), ("gain 3 2", "delay 0 30"), ("zero 2 10", "delay 0 30")),
    *(("tilt 0 3", "gain 2 0.7"), ("drift 0 -35", "gain 3 2"), ("zero 2 20", "drift 0 -35")),
)


def pairs(sets: int, robot: str, first: int) -> Iterator[str]:
    """What is said of two mistakes at once, on seeds that no level was chosen on: both, one of them, wrong causes."""
    model = model_of(robot)
    counts: dict[str, int] = {}
    for seed in range(first, first + sets):
        given = case(model, 700 + seed, 30.0, 0.1, noise=0.01)
        for pair in PAIRS:
            true = {(kind, int(joint) - 1) for kind, joint, _ in (each.split() for each in pair)}
            findings = comparison(mistaken(mistaken(given, pair[0]), pair[1])).findings()
            said = [(each.outcome.hypothesis.subject, each.outcome.hypothesis.joint, each.named) for each in findings]
            right = {(k, j) for k, j in true if any(k == a and (k == "tilt" or j == b) for a, b, _ in said)}
            whole = {
                k for k, j in true if k == "tilt" or (k == "drift" and j < 0)
            }  # one joint's drift is a part of all
            wrong = [each for each in said if each[0] not in whole and each[:2] not in true]
            for what in (f"{len(right)} of 2", *(f"WRONG {'named' if named else 'possible'}" for *_, named in wrong)):
                counts[what] = counts.get(what, 0) + 1
            yield f"{' and '.join(pair)}: {len(right)} of 2{''.join(f', WRONG {a} {b + 1}' for a, b, _ in wrong)}"
    yield f"{robot}: {counts}"


def mistaken(given: Case, mistake: str) -> Case:
    """The set with a mistake, such as ``zero 2 90`` (joint, deg), ``gain 3 2``, ``delay 0 30`` (ms; joint 0 is all).

    There are also ``tilt 0 2`` (deg) and ``drift 2 -35`` (%, viscous friction from beginning to end; joint 0 is all).
    """
    log, (kind, joint, size) = given.log, mistake.split()
    at = [int(joint) - 1] if joint != "0" else list(range(given.model.n))
    value = float(size)
    q, tau = log.q.copy(), np.asarray(log.tau).copy()
    if kind == "zero":
        q[:, at] -= np.radians(value)
    elif kind == "gain":
        tau[:, at] *= value
    elif kind == "delay":
        for j in at:
            tau[:, j] = np.interp(log.t - 1e-3 * value, log.t, tau[:, j])
    elif kind == "tilt":
        beta = given.theta[: len(given.model.beta)]
        tau += np.radians(value) * comparison(given).influence.gravity(0, q, beta)
    elif kind == "drift":
        s = (log.t - log.t[0]) / (log.t[-1] - log.t[0]) - 0.5
        dq = np.gradient(q, PERIOD, axis=0)
        names = list(given.regressor.names)
        for j in at:
            tau[:, j] += 0.01 * value * given.theta[names.index(f"fv{j + 1}")] * s * dq[:, j]
    return replace(given, log=replace(log, q=q, tau=tau))


STUDIES: dict[str, Callable[[int, str, int], Iterator[str]]] = {
    "coverage": coverage,
    "bands": bands,
    "detection": detection,
    "pairs": pairs,
}


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(list(STUDIES)))
@click.option("--sets", default=40, help="Number of sets a case.")
@click.option("--robot", default="puma560", help="Robot file or name of a bundled robot.")
@click.option(
    "--first", default=0, help="Seed of the first set; the others follow. No level was chosen on 1000 and more."
)
def main(names: tuple[str, ...], sets: int, robot: str, first: int) -> None:
    """Run the studies NAMES, all of them without one."""
    for name in names or tuple(STUDIES):
        for line in STUDIES[name](sets, robot, first):
            click.echo(f"{name}: {line}")


if __name__ == "__main__":
    main()
