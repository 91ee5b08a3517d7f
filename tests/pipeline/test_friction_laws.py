"""Friction laws in the robot file: read and written, emitted, verified, refused where they are wrong."""

from __future__ import annotations

import subprocess
from types import SimpleNamespace

import numpy as np
import pytest
from jsonschema import validate
from ruamel.yaml import YAML

import rrrgen
from controller.test_emitted_programs import Emitted
from robot.friction.examples import EXAMPLES
from rrrgen.base.errors import InputError
from rrrgen.emit.c.function_files import function_files
from rrrgen.lab.friction.report import with_friction
from rrrgen.robot.file import dumps, json_schema, loads_spec
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import FrictionModel, MixedFriction, robot_friction
from rrrgen.verify.against_newton_euler import check_friction
from rrrgen.verify.references.numeric_robot import chain_of
from rrrgen.verify.report import DOUBLE, Collector
from rrrgen.verify.subject import draw_states

HEAD = """schema: rrrgen/1
name: lawful
convention: standard
units: {angle: deg, length: mm}
gravity: [0, 0, -9.81]
joints:
"""
NAMES = list(LAWS)


def friction_text(name: str) -> str:
    values = [f"{p.name}: {v!r}" for p, v in zip(LAWS[name].parameters, EXAMPLES[name][0], strict=True)]
    linear = [] if name == "coulomb_viscous" else ["offset: 0.3"]
    return "{" + ", ".join([f"law: {name}", *values, *linear]) + "}"


def robot(friction: list[str], drives: str = "") -> str:
    rows = [
        f"  - {{name: j{i}, type: revolute, alpha: 0, a: 300, d: 0, friction: {text}}}"
        for i, text in enumerate(friction)
    ]
    link = "  - {mass: 2, com: [-100, 0, 0], inertia: {about: com, xx: 0.02, yy: 0.03, zz: 0.04}}"
    return HEAD + "\n".join(rows) + "\nlinks:\n" + "\n".join([link] * len(friction)) + "\n" + drives


EVERY = [friction_text(name) for name in NAMES]
DAHL = [friction_text("dahl"), friction_text("dahl_exponential")]


def test_every_law_is_read_and_written_exactly():
    spec = loads_spec(robot(EVERY))
    again = loads_spec(dumps(spec))
    assert again.joints == spec.joints
    validate(YAML(typ="safe").load(dumps(spec)), json_schema())
    for name, joint in zip(NAMES, spec.joints, strict=True):
        if name != "coulomb_viscous":
            assert joint.friction.law.name == name
            assert joint.friction.law.values == tuple(EXAMPLES[name][0])
            assert joint.friction.offset == 0.3


def test_units_of_the_parameters():
    text = robot(["{law: stribeck, coulomb: 2000 N*mm, stribeck_speed: 10 deg/s, viscous: 1}"])
    law = loads_spec(text).joints[0].friction.law
    assert law.values == pytest.approx((0.0, 2.0, 1.0, np.radians(10)))


@pytest.mark.parametrize(
    ("friction", "message"),
    [
        ("{law: coulom, coulomb: 1}", "law: 'coulom' is not allowed"),
        ("{law: dahl, coulomb: 1}", "the friction law dahl of joint 1 needs 'presliding'"),
        ("{law: dahl, coulomb: 1, presliding: -1}", "presliding of joint 1 is -1"),
        ("{law: stribeck, coulomb: 1, stribeck_speed: 0}", "stribeck_speed of joint 1 is 0"),
        ("{law: dahl, presliding: 1, quadratic: 2}", "the friction law dahl of joint 1 has no 'quadratic'"),
        ("{coulomb: 1, presliding: 1}", "the friction law coulomb_viscous of joint 1 has no 'presliding'"),
        ("{law: dahl, presliding: 1 N*m}", "presliding of joint 1"),
        ("{law: dahl, presliding: 1, coulomb: -2}", "coulomb of joint 1 is -2"),
        (
            "{law: lugre, sigma0: 1, coulomb: 2, stribeck_speed: 1, stiction_excess: -2}",
            "stiction_excess of joint 1 is -2",
        ),
    ],
)
def test_faults_are_told(friction, message):
    with pytest.raises(InputError) as caught:
        loads_spec(robot([friction]))
    fault = caught.value.faults[0]
    assert message in fault.message
    assert fault.line == 7


COUPLED = """drives:
  joint_from_drive: [[1, 1], [-1, 1/2]]
  motors:
    - {name: left, gear_ratio: 30, friction: {law: dahl, coulomb: 0.02, viscous: 1e-3, presliding: 2e-3, offset: 0.01}}
    - {name: right, friction: {law: exponential, coulomb: 0.5, excess: -0.2, decay_speed: 0.3}}
"""
LOADED = COUPLED.replace(
    "law: dahl, coulomb: 0.02", "law: dahl_load_dependent, decay_speed: 0.2, load_ratio: 0.05"
).replace(
    "law: exponential, coulomb: 0.5, excess: -0.2, decay_speed: 0.3",
    "law: load_dependent, coulomb: 0.5, load_ratio: 0.1",
)


@pytest.mark.parametrize(
    "text", [robot(EVERY[k : k + 2]) for k in range(0, len(EVERY), 2)] + [robot(DAHL, COUPLED), robot(DAHL, LOADED)]
)
def test_friction_is_verified(text):
    """Against the formulas retyped in the verifier, without a compiler; C is compared below."""
    rows = friction_rows(rrrgen.compile(loads_spec(text), backend="numpy"))
    assert max(row.difference for row in rows.values()) < 1e-12
    assert ("friction_step: z" in rows) == ("dahl" in text or "lugre" in text)


def friction_rows(model):
    chain = chain_of(model.spec)
    collected = Collector()
    check_friction(model, draw_states(chain, 20, np.random.default_rng(0)), DOUBLE, collected)
    assert collected.rows
    return {row.function: row for row in collected.rows}


def test_a_wrong_state_is_found():
    model = rrrgen.compile(loads_spec(robot(DAHL, COUPLED)), backend="numpy")
    step = model.friction_step
    model.friction_step = lambda *states: (-step(*states)[0], step(*states)[1])
    assert {name for name, row in friction_rows(model).items() if row.difference > 1e-12} == {"friction_step: z"}


def test_mixed_friction_is_that_of_the_compiled_model():
    names = ["coulomb_viscous", "dahl_exponential", "lugre", "neural"]
    spec = loads_spec(robot([friction_text(name) for name in names]))
    model, mixed = rrrgen.compile(spec, backend="numpy"), robot_friction(spec)
    assert isinstance(mixed, MixedFriction)
    assert mixed.has_state
    dq = np.random.default_rng(1).uniform(-2, 2, (50, 4))
    dq[0] = 0.0
    assert mixed.torque(dq) == pytest.approx(model.friction(dq), rel=1e-12, abs=1e-12)
    assert mixed.torque_in_direction(dq, np.sign(dq)) == pytest.approx(mixed.torque(dq))
    z = 1e-5 * dq
    i = 1
    alone = FrictionModel(LAWS[names[i]], np.array([EXAMPLES[names[i]][0]]))
    assert mixed.rate(z, dq)[:, [i]] == pytest.approx(alone.rate(z[:, [i]], dq[:, [i]]))
    assert mixed.state_torque(z, dq)[:, [i]] == pytest.approx(alone.state_torque(z[:, [i]], dq[:, [i]]) + 0.3)


def test_a_law_at_a_joint_and_at_its_only_motor_is_refused():
    text = robot(EVERY[5:7], COUPLED.replace("[1, 1]", "[1, 0]"))
    with pytest.raises(InputError, match="friction law is given twice: here and at joint 'j0'"):
        loads_spec(text)


def test_the_emitted_c_is_the_law():
    model = rrrgen.compile(loads_spec(robot(DAHL, COUPLED)), backend="numpy")
    emitted = Emitted([model.derived.programs[name] for name in ("friction", "friction_step")])
    rng = np.random.default_rng(2)
    dq, z = rng.uniform(-2, 2, (20, 2)), 1e-4 * rng.uniform(-1, 1, (20, 3))
    assert emitted.call("friction", dq)[0] == pytest.approx(model.friction(dq), rel=1e-13)
    for mine, wanted in zip(emitted.call("friction_step", dq, z, 1e-3), model.friction_step(dq, z, 1e-3), strict=True):
        assert mine == pytest.approx(wanted, rel=1e-13)


def test_emitted_bristles_are_those_of_an_own_integration_and_end_on_the_stribeck_curve():
    """One period at constant speed, against (14.13) in small steps; the logistic law beside it has no state."""
    model = rrrgen.compile(loads_spec(robot([friction_text("lugre"), friction_text("logistic")])), backend="numpy")
    emitted = Emitted([model.derived.programs["friction_step"]])
    sigma0, sigma1, excess, coulomb, viscous, speed = EXAMPLES["lugre"][0]
    span, steepness, shift = EXAMPLES["logistic"][0]
    rng = np.random.default_rng(3)
    dq, start, period = rng.uniform(-0.5, 0.5, (20, 2)), 2e-4 * rng.uniform(-1, 1, 20), 5e-4
    v, at = dq[:, 0], dq[:, 1]
    level = coulomb + excess * np.exp(-((v / speed) ** 2))
    logistic = span / (1 + np.exp(-steepness * (at + shift))) - span / (1 + np.exp(-steepness * shift)) + 0.3

    def rate(z):
        return v - sigma0 * np.abs(v) / level * z

    z, h = start, period / 2000
    for _ in range(2000):  # Runge-Kutta
        a = rate(z)
        b = rate(z + h / 2 * a)
        c = rate(z + h / 2 * b)
        z = z + h / 6 * (a + 2 * b + 2 * c + rate(z + h * c))
    got, tau = emitted.call("friction_step", dq, start[:, None], period)
    assert got[:, 0] == pytest.approx(z, rel=1e-12, abs=1e-17)
    bristles = sigma0 * z + sigma1 * (z - start) / period + viscous * v + 0.3
    assert tau == pytest.approx(np.column_stack([bristles, logistic]), rel=1e-11)
    resting, _ = emitted.call("friction_step", 0.0 * dq, start[:, None], period)
    assert np.array_equal(resting[:, 0], start)
    _, sliding = emitted.call("friction_step", dq, got, 1e3)
    long = level * np.sign(v) + sigma1 * (level * np.sign(v) / sigma0 - got[:, 0]) / 1e3 + viscous * v + 0.3
    assert sliding[:, 0] == pytest.approx(long, rel=1e-13)


@pytest.mark.parametrize("real", ["double", "float"])
def test_the_emitted_c_compiles_without_warnings(tmp_path, real):
    model = rrrgen.compile(loads_spec(robot(DAHL, COUPLED)), backend="numpy")
    programs = [model.derived.programs[name] for name in ("friction", "friction_step")]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]
    for name, text in function_files("lawful_friction", "Friction.", programs, real).items():
        (tmp_path / name).write_text(text)
    for source in tmp_path.glob("*.c"):
        subprocess.run(["cc", *flags, "-c", str(source), "-o", str(tmp_path / "out.o")], check=True)


def test_an_estimate_without_friction_at_rest_is_written_so_that_it_can_be_read():
    values = (5700.0, 0.0, -0.58, 0.37, 0.0, 0.007)
    candidate = SimpleNamespace(law=LAWS["lugre"], law_values=lambda theta: theta, offset=False)
    chosen = SimpleNamespace(candidate=candidate, theta=np.array(values), values={}, std={})
    spec = loads_spec(dumps(with_friction(loads_spec(robot(["{viscous: 0}"])), "j0", chosen)))
    assert spec.joints[0].friction.law.values == pytest.approx((*values[:2], -0.37, *values[3:]))
