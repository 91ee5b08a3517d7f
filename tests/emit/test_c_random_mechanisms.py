"""Random trees, floating bases and loops, in compiled C, against Pinocchio and MuJoCo to 1e-12."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from oracles.free_base import FreeMujoco, FreePinocchio
from oracles.random_robots import random_link
from rrrgen.derive import derive_model
from rrrgen.derive.optimizer import Optimizer
from rrrgen.robot.file import loads_spec
from rrrgen.robot.identity import identify
from rrrgen.runtime.floating_base import FloatingState, rotation, to_mujoco, to_pinocchio
from rrrgen.runtime.load import load_model
from rrrgen.verify.references.libraries import LIBRARIES, ClosedReference, MujocoReference
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters
from rrrgen.verify.subject import draw_states
from samples.draws import draws

pin = pytest.importorskip("pinocchio")
mujoco = pytest.importorskip("mujoco")

TOLERANCE = 1e-12  # relative to the largest torque or entry
STATES = 5
AT_REST = ("inverse_dynamics", "mass_matrix", "regressor")
AFLOAT = ("floating_inverse_dynamics", "floating_mass_matrix", "floating_regressor")
HEAD = "schema: rrrgen/1\nname: drawn\nconvention: modified\nunits: {angle: rad, length: m}\n"


def compiled(spec, names):
    """The model with the functions ``names`` and their specializations alone, in C."""
    recorded = derive_model(spec)
    of_them = {"bias", "floating_bias", "floating_mass_matrix", *names}  # forward dynamics are made of these
    alternatives = {name: ways for name, ways in recorded.alternatives.items() if name in of_them}
    derived = Optimizer()(recorded.only(alternatives))
    wanted = {f"{name}{end}" for name in names for end in ("", "_nominal")}
    programs = {name: program for name, program in derived.programs.items() if name in wanted}
    return load_model(dataclasses.replace(derived, programs=programs), identify(spec))


def inertia(rng) -> str:
    link = random_link(rng)
    com = ", ".join(repr(float(v)) for v in link.com)
    tensor = ", ".join(
        f"{name}: {float(link.inertia[place])!r}"
        for name, place in zip(
            ("xx", "yy", "zz", "xy", "xz", "yz"), ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)), strict=True
        )
    )
    return f"mass: {float(link.mass)!r}, com: [{com}], inertia: {{about: com, {tensor}}}"


def gravity(rng) -> str:
    return f"gravity: {[round(float(v), 2) for v in rng.uniform(-9, 9, 3)]}\n"


def placement(rng, right: float) -> str:
    """Angles, which are right with the probability ``right``, and lengths, a third of them zero."""

    def value(key: str) -> str:
        angle = key in ("gamma", "alpha", "theta")
        if rng.random() < (right if angle else 0.33):
            return str(rng.choice(("0", "pi/2", "-pi/2"))) if angle else "0"
        return f"{rng.uniform(-1, 1):.2f}"

    return ", ".join(f"{key}: {value(key)}" for key in ("gamma", "b", "alpha", "a", "theta", "d"))


def tree(seed: int, trunk: bool = False) -> str:
    """A stem with two to four branches of mixed joints, each perhaps behind a fixed row, and a tip on each of them.

    Most angles are right, on a trunk all of them: base parameters of odd ones take minutes, and tests/derive has some.
    """
    rng = np.random.default_rng(seed)
    rows, links, tips = [], [], []
    with_links = rng.random() < 0.5  # of fixed rows

    def grow(name: str, parent: str, fixed: bool) -> str:
        kind = "prismatic" if rng.random() < 0.3 else "revolute"
        held = ", follows: {}" if fixed else ""
        rows.append(
            f"  - {{name: {name}, type: {kind}, parent: {parent}, {placement(rng, 1.0 if trunk else 0.85)}{held}}}\n"
        )
        if with_links or not fixed:
            links.append(f"  - {{{inertia(rng)}}}\n")
        return name

    stem = "base"
    for k in range(int(rng.integers(0 if trunk else 1, 3))):
        stem = grow(f"stem{k}", stem, False)
    for branch in range(int(rng.integers(2, 5))):
        end = stem
        if rng.random() < 0.5:
            end = grow(f"held{branch}", end, True)
        for k in range(int(rng.integers(1, 3))):
            end = grow(f"branch{branch}{k}", end, False)
        tips.append(f"  tip{branch}: {{row: {end}}}\n")
    base = f"floating_base: {{name: trunk, {inertia(rng)}}}\n" if trunk else ""
    parts = (HEAD, gravity(rng), base, "joints:\n", *rows, f"tip: {end}\ntips:\n", *tips, "links:\n", *links)
    return "".join(parts)


def difference(found, expected) -> float:
    return float(np.max(np.abs(np.asarray(found) - expected)) / max(np.max(np.abs(expected)), 1e-9))


def rank(rows: np.ndarray) -> int:
    lengths = np.linalg.norm(rows, axis=0)
    scaled = rows[:, lengths > 1e-9] / lengths[lengths > 1e-9]
    sizes = np.linalg.svd(scaled, compute_uv=False)
    return int(np.sum(sizes > 1e-9 * sizes[0]))


@pytest.mark.parametrize("seed", range(draws(2)))
def test_random_trees(seed):
    spec = loads_spec(tree(seed))
    model, chain, phi = compiled(spec, AT_REST), chain_of(spec), nominal_parameters(spec)
    references = [LIBRARIES[name](chain, phi) for name in ("Pinocchio", "MuJoCo")]
    rng = np.random.default_rng(seed)
    beta = np.asarray(model.beta)
    for q, dq, ddq in rng.uniform(-1, 1, (STATES, 3, spec.n)):
        for reference in references:
            tau = reference.inverse_dynamics(q, dq, ddq)
            assert difference(model.inverse_dynamics(q, dq, ddq), tau) < TOLERANCE, reference.name
            assert difference(model.inverse_dynamics(q, dq, ddq, beta=beta), tau) < TOLERANCE, reference.name
            assert difference(model.regressor(q, dq, ddq) @ beta, tau) < TOLERANCE, reference.name
            assert difference(model.mass_matrix(q), reference.mass_matrix(q)) < TOLERANCE, reference.name
    unit = NewtonEuler(chain, np.zeros((chain.links, 10)))
    s = draw_states(chain, 8 * chain.links, rng)
    assert len(beta) == rank(unit.standard_regressor(s.q, s.dq, s.ddq).reshape(-1, 10 * chain.links))


@pytest.mark.parametrize("seed", range(draws(2)))
def test_random_trees_on_a_floating_base(seed):
    spec = loads_spec(tree(100 + seed, trunk=True))
    model, rng = compiled(spec, AFLOAT), np.random.default_rng(seed)
    free, joined = FreePinocchio(spec), FreeMujoco(chain_of(spec), nominal_parameters(spec))
    beta, rows = np.asarray(model.beta), []
    for k in range(8 * len(spec.rows)):
        orientation = rng.normal(size=4)
        orientation /= np.linalg.norm(orientation)
        s = FloatingState(rng.normal(size=3), orientation, *rng.normal(size=(2, 6)), *rng.normal(size=(3, spec.n)))
        packed = to_pinocchio(s)
        rows.append(free.regressor(*packed))
        if k >= STATES:
            continue
        state = (s.q, s.dq, s.ddq, s.orientation, s.twist, s.twist_rate)
        forces = np.concatenate(model.floating_inverse_dynamics(*state)[:2])
        by_mujoco = joined.forces(*to_mujoco(s))
        by_mujoco[:3] = rotation(s.orientation).T @ by_mujoco[:3]  # its force on the base is in world axes
        assert difference(forces, free.inverse_dynamics(*packed)) < TOLERANCE
        assert difference(forces, by_mujoco) < TOLERANCE
        assert difference(model.floating_regressor(*state) @ beta, forces) < TOLERANCE
        assert difference(model.floating_mass_matrix(s.q), free.mass_matrix(packed[0])) < TOLERANCE
    assert len(beta) == rank(np.concatenate(rows))


def loop(seed: int) -> str:
    """A four-bar or five-bar of random sides on a yawing column, that can be assembled everywhere."""
    rng = np.random.default_rng(seed)
    five, base = seed % 2, rng.uniform(0.4, 0.6)
    crank, arm = rng.uniform(0.08, 0.14, 2) if five else (rng.uniform(0.08, 0.2), 0.0)
    rod = rng.uniform(0.52, 0.7)
    lever = rod + rng.uniform(0.03, 0.1) * rng.choice([-1, 1])
    lines = [
        f"  - {{name: column, type: revolute, alpha: {rng.choice(['0', 'pi/2', '0.40'])}, a: 0.1, d: 0.2}}\n",
        f"  - {{name: crank, type: revolute, alpha: pi/2, a: 0.05, d: 0, theta: {rng.uniform(-1, 1):.2f}}}\n",
        f"  - {{name: rod, type: revolute, alpha: 0, a: {crank:.3f}, d: 0}}\n",
        f"  - {{name: arm, type: revolute, parent: column, alpha: pi/2, a: {0.05 + base:.3f}, d: 0}}\n",
    ]
    if five:
        lines.append(f"  - {{name: lever, type: revolute, alpha: 0, a: {arm:.3f}, d: 0}}\n")
    last = "lever" if five else "arm"
    loops = (
        f"loops:\n  bars:\n    passive: [rod, {last}]\n"
        f"    pins: {{rod: [{rod:.3f}, 0, 0], {last}: [{lever:.3f}, 0, 0]}}\n    assembly: {rng.choice(['+1', '-1'])}\n"
    )
    links = "".join(f"  - {{{inertia(rng)}}}\n" for _ in lines)
    return "".join((HEAD, gravity(rng), "joints:\n", *lines, loops, f"tip: {last}\n", "links:\n", links))


class Connected(MujocoReference):
    """The open tree with both sides of the pin as sites that an equality connects.

    Rates and accelerations of the passive rows follow from the Jacobian of the constraint and from the accelerations of
    the sites, all of them MuJoCo's.
    """

    def __init__(self, chain, phi) -> None:
        (self._loop,) = chain.loops
        super().__init__(chain.spanning_tree(), phi)
        self._drives, self._passive = chain.n, list(self._loop.passive)
        self._connected = mujoco.MjModel.from_xml_string(self._mjcf(chain.spanning_tree(), phi))
        self._connected.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE

    def _mjcf(self, chain, phi) -> str:
        text = super()._mjcf(chain, phi)
        after = [behind for _, behind in chain.around_joints()]
        for k, (row, place) in enumerate(self._loop.pins):
            here, at = f'<joint name="joint{row}"', " ".join(map(repr, map(float, (after[row] @ [*place, 1])[:3])))
            text = text.replace(here, f'<site name="pin{k}" pos="{at}"/>{here}')
        return text.replace("</mujoco>", '<equality><connect site1="pin0" site2="pin1"/></equality></mujoco>')

    def reduced(self, x, dq, ddq):
        """The gap of the pin (m), W (2, n), torques tau (n,) and M (n, n) at positions x (n + 2,) of all rows."""
        model, places = self._connected, self._places
        data, n = mujoco.MjData(model), self._drives
        data.qpos[places] = self._coupling @ x
        mujoco.mj_forward(model, data)
        gap = float(np.abs(data.efc_pos).max())
        J = np.reshape(data.efc_J, (-1, model.nv))[:, places] @ self._coupling
        W = np.linalg.lstsq(J[:, n:], -J[:, :n], rcond=None)[0]
        S = np.concatenate([np.eye(n), W])
        v = self._coupling @ S @ dq
        a = np.concatenate([ddq, np.zeros(2)])
        data.qvel[places], data.qacc[places] = v, self._coupling @ a
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        sites = np.zeros((2, 6))
        for k, row in enumerate(sites):
            mujoco.mj_objectAcceleration(model, data, mujoco.mjtObj.mjOBJ_SITE, model.site(f"pin{k}").id, row, 0)
        a[n:] = np.linalg.lstsq(J[:, n:], -(sites[0] - sites[1])[3:], rcond=None)[0]
        tau = self.inverse_dynamics(x, S @ dq, a)
        return gap, W, S.T @ tau, S.T @ self.mass_matrix(x) @ S


@pytest.mark.parametrize("seed", range(draws(2)))
def test_random_loops(seed):
    """Also with Pinocchio's tree, reduced by a solution of the loop by Newton's method."""
    spec = loads_spec(loop(seed))
    model, chain, phi = compiled(spec, (*AT_REST, "closed_loops")), chain_of(spec), nominal_parameters(spec)
    connected, pinocchio = Connected(chain, phi), ClosedReference(LIBRARIES["Pinocchio"], chain, phi)
    s = draw_states(chain, STATES, np.random.default_rng(seed))
    beta = np.asarray(model.beta)
    for q, dq, ddq in zip(s.q, s.dq, s.ddq, strict=True):
        passive, W, _ = model.closed_loops(q)
        x = np.concatenate([q, np.arctan2(passive[:, 1], passive[:, 0])])
        gap, rates, tau, M = connected.reduced(x, dq, ddq)
        assert gap < 1e-14
        assert difference(W, rates) < TOLERANCE
        for torques, mass in (
            (tau, M),
            (pinocchio.inverse_dynamics(q, dq, ddq), pinocchio.mass_matrix(q)),
        ):
            assert difference(model.inverse_dynamics(q, dq, ddq), torques) < TOLERANCE
            assert difference(model.inverse_dynamics(q, dq, ddq, beta=beta), torques) < TOLERANCE
            assert difference(model.regressor(q, dq, ddq) @ beta, torques) < TOLERANCE
            assert difference(model.mass_matrix(q), mass) < TOLERANCE
    unit = NewtonEuler(chain, np.zeros((chain.links, 10)))
    s = draw_states(chain, 8 * chain.links, np.random.default_rng(seed))
    assert len(beta) == rank(unit.standard_regressor(s.q, s.dq, s.ddq).reshape(-1, 10 * chain.links))
