"""The inverse kinematics as JavaScript: a recorded closed form as nested loops over roots, in a module of its own.

``<name>_ik.mjs`` has no dependencies. Views move an arm by it: all configurations of a tip pose, or the nearest one by
damped least squares where the pose cannot be reached or the arm has no solver. A controller uses the emitted C, which
treats round-off at singular configurations with more care. A general arm, which has no closed form, and a mechanism,
whose joint values are found for every way in which the drives can stand, are solved by the statements of that C in
JavaScript.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rrrgen.base.errors import InternalError
from rrrgen.base.templates import render
from rrrgen.emit.c.ik.files import emit
from rrrgen.emit.interface import ATOM, PRODUCT, SUM, UNARY, Text
from rrrgen.emit.printing import wrap
from rrrgen.emit.targets.javascript_from_c import Translation, translate
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.classify import tip_plans
from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.plan import ARM_ANGLE, SolverPlan
from rrrgen.ik.recording.float_builder import OUTSIDE
from rrrgen.ik.recording.scalar import SolverScalar
from rrrgen.ik.recording.steps import (
    GivenStep,
    NamedStep,
    OntoStep,
    PairStep,
    PolynomialStep,
    QuarticStep,
    ResidualStep,
    SignedRootStep,
    SlideStep,
    Step,
    TargetStep,
    TurnStep,
    WristStep,
)
from rrrgen.ik.result_layout import STATUS, labels
from rrrgen.program import Op

if TYPE_CHECKING:
    from rrrgen.robot.identity import Identity
    from rrrgen.robot.spec import RobotSpec


def modules(spec: RobotSpec, identity: Identity) -> dict[str, str]:
    """The modules of the tip, named ``""``, and of every named tip that has a solver, by the name of the tip."""
    texts = {"": module(spec, identity)}
    for tip, (arm, _) in tip_plans(spec).items():
        texts[tip] = module(arm, identity)
    return {name: text for name, text in texts.items() if text is not None}


def module(spec: RobotSpec, identity: Identity) -> str | None:
    """Print the module of the inverse kinematics; None for a mechanism without a solver."""
    plan = make_plan(spec)
    if spec.mechanism is not None and not plan.solvable:
        return None
    chain, solver, coupling = plan.chain, plan.solver, plan.coupling
    kernels = _translate_c(spec, plan) if plan.general or coupling is not None else None
    matrices = [[[float(x) for x in row] for row in matrix] for matrix in chain.transforms]
    axes = [
        {"name": joint.name, "revolute": joint.revolute, "sign": joint.sign, "offset": float(joint.offset)}
        for joint in chain.joints
    ]
    joints = [
        {"name": joint.name, "revolute": joint.is_revolute, "lower": joint.limits.lower, "upper": joint.limits.upper}
        for joint in spec.joints
    ]
    followers = [] if coupling is None else coupling.followers
    return render(
        "javascript/ik.mjs.j2",
        identity=identity,
        name=spec.name,
        title=wrap(f"{plan.title[0].upper()}{plan.title[1:]}."),
        reason=wrap(_without(plan)),
        position=plan.task == "position",
        axes=[json.dumps(axis) for axis in axes],
        joints=[json.dumps(joint) for joint in joints],
        factors=None if coupling is None else [json.dumps(row) for row in coupling.matrix],
        followers=[
            json.dumps({"along": follower.factors, "lower": follower.lower, "upper": follower.upper})
            for follower in followers
        ],
        transforms=[json.dumps(matrix) for matrix in matrices],
        reach=repr(chain.reach),
        locked="null" if plan.locked in (None, ARM_ANGLE) else str(plan.locked),
        arm_angle=plan.locked == ARM_ANGLE,
        shoulder=float(chain.links[0].d) if plan.locked == ARM_ANGLE else 0.0,
        redundancy=plan.redundancy,
        branches=None if solver is None or kernels is not None else _Writer(plan).lines(),
        closed=solver is not None,
        kernels=kernels,
        out=json.dumps(kernels.places["out"]) if kernels else None,
        labels=json.dumps([[name, bit, (1 << bits) - 1] for name, bit, bits in labels(plan)]) if kernels else None,
        statuses=json.dumps(STATUS),
        outside=OUTSIDE,
    )


def _translate_c(spec: RobotSpec, plan: SolverPlan) -> Translation:
    """The emitted C as JavaScript."""
    files, name = emit(spec, plan).files, spec.name
    arrays = {"target": 3 if plan.task == "position" else 16, "q_ref": plan.n}
    return translate(files[f"{name}_ik.h"], files[f"{name}_ik.c"], f"{name}_inverse_kinematics", arrays)


def _without(plan: SolverPlan) -> str:
    """Text that says why no closed form is printed, or by what the arm is solved; empty where one is printed."""
    translated = "the functions after the forward kinematics are the emitted C in JavaScript"
    if plan.coupling is not None:
        return f"A mechanism: {translated}."
    if plan.solver is not None:
        return ""
    if plan.general:
        return f"There is no closed form: {translated}."
    return f"There is no closed form: {plan.reason}."


class _Writer:
    """Prints the steps of a recorded solver in their order; each choice of a root opens a loop that ends at the end."""

    def __init__(self, plan: SolverPlan) -> None:
        self._n, self._steps = plan.n, list(plan.equations.live())
        self._uses: dict[int, int] = {}
        self._texts: dict[int, Text] = {}
        self._lines: list[str] = []
        self._depth = 0
        self._values: dict[int, str] = {}
        self._labels: list[tuple[str, str]] = []
        for step in self._steps:
            for operand in self._operands(step):
                self._count(operand)

    def lines(self) -> list[str]:
        """The statements of the function that collects candidates."""
        for step in self._steps:
            self._write(step)
        labels = ", ".join(f"{json.dumps(label)}: {variable}" for label, variable in self._labels)
        values = ", ".join(self._values[j] for j in range(self._n))
        self._line(f"candidates.push({{ q: [{values}], branch: {{ {labels} }} }});".replace("{  }", "{}"))
        while self._depth:
            self._depth -= 1
            self._line("}")
        return self._lines

    @staticmethod
    def _operands(step: Step) -> Sequence[SolverScalar]:
        return () if isinstance(step, ResidualStep) else step.operands  # a candidate is tried on the forward kinematics

    def _count(self, node: SolverScalar) -> None:
        self._uses[id(node)] = self._uses.get(id(node), 0) + 1
        if self._uses[id(node)] == 1:
            for arg in node.args:
                self._count(arg)

    def _line(self, text: str) -> None:
        self._lines.append("  " * self._depth + text)

    def _write(self, step: Step) -> None:
        names = [result.text for result in step.results]
        results = f"[{', '.join(names)}]"
        if isinstance(step, ResidualStep):
            return
        if isinstance(step, TargetStep):
            entries = [f"T[{i}][{j}]" for i in range(3) for j in range(3)] if len(names) == 12 else []
            entries += [f"T[{i}][3]" for i in range(3)]
            self._line(f"const {results} = [{', '.join(entries)}];")
        elif isinstance(step, NamedStep):
            self._line(f"const {names[0]} = {self._text(step.value).code};")
        elif isinstance(step, SlideStep):
            self._line(f"const {names[0]} = {self._text(step.value).code};")
            self._set(step.joint, names[0])
        elif isinstance(step, TurnStep):
            self._line(f"const {results} = direction({self._call(step.c, step.s)}, {self._reference(step.joint)});")
            self._set(step.joint, *names)
        elif isinstance(step, OntoStep):
            bounds = "" if step.feasible is None else f", [{self._call(*step.feasible)}]"
            ends = f"[{self._call(*step.v)}], [{self._call(*step.u)}]"
            self._line(f"const {results} = onto({ends}, {step.unit!r}, {self._reference(step.joint)}{bounds});")
            self._set(step.joint, *names)
        elif isinstance(step, GivenStep):
            self._write_given_joint(step, names)
        else:
            self._choice(step, names)

    def _choice(self, step: Step, names: list[str]) -> None:
        number = f"choice{len(self._labels) + 1}"
        if isinstance(step, PairStep):
            better = "null" if step.radicand is None else self._text(step.radicand).code
            call = (
                f"pair({self._call(*step.equation)}, {better}, {step.unit!r}, {self._reference(step.joint)}, "
                f"{step.label.positive})"
            )
        elif isinstance(step, SignedRootStep):
            call = f"signedRoot({self._call(step.radicand, step.size)}, {step.unit!r}, {step.label.positive})"
        elif isinstance(step, QuarticStep):
            call = f"quartic([{self._call(*step.k)}])"
        elif isinstance(step, PolynomialStep):
            call = f"polynomial([{self._call(*step.k)}], {step.unit!r})"
        elif isinstance(step, WristStep):
            first, last = (f"[{self._call(*column)}]" for column in step.columns)
            call = f"wrist({first}, {last}, {step.signs[0]}, {step.signs[1]}, {self._reference(step.three[0])})"
        else:
            raise InternalError(f"the step '{step.kind}' is not printed in JavaScript")
        self._line(f"for (const [{', '.join([*names, number])}] of {call}) {{")
        self._depth += 1
        self._labels.append((step.stage.label if step.stage else "", number))
        if isinstance(step, WristStep):
            for k, joint in enumerate(step.three):
                self._set(joint, *names[2 * k : 2 * k + 2])
        elif isinstance(step, PairStep | QuarticStep | PolynomialStep):
            self._set(step.joint, *names)

    def _write_given_joint(self, step: GivenStep, names: list[str]) -> None:
        joint = step.joint
        raw = f"{'-' if joint.sign < 0 else ''}given{self._shift(float(joint.offset))}"
        values = [f"Math.cos({raw})", f"Math.sin({raw})"] if joint.revolute else [raw]
        self._line(f"const [{', '.join(names)}] = [{', '.join(values)}];")
        self._values[joint.index] = "given"

    def _set(self, joint: Joint, *names: str) -> None:
        """Note the expression of the user's value of a joint: from cosine and sine, or from a raw value."""
        raw = names[0] if len(names) == 1 else f"Math.atan2({names[1]}, {names[0]})"
        moved = f"{raw}{self._shift(-float(joint.offset))}"
        value = moved if joint.sign > 0 else f"-({moved})"
        self._values[joint.index] = f"wrapped({value})" if joint.revolute else value

    def _reference(self, joint: Joint) -> str:
        """The raw value of a joint at the reference configuration."""
        if joint.index >= self._n:
            return repr(float(joint.offset))
        return f"{'-' if joint.sign < 0 else ''}near[{joint.index}]{self._shift(float(joint.offset))}"

    @staticmethod
    def _shift(offset: float) -> str:
        return f" {'-' if offset < 0 else '+'} {abs(offset)!r}" if offset else ""

    def _call(self, *nodes: SolverScalar) -> str:
        return ", ".join(self._text(node).code for node in nodes)

    def _text(self, node: SolverScalar) -> Text:
        """The expression of a node; one that is used more than once becomes a constant where it is first needed."""
        if node.op is Op.INPUT:
            return Text(node.text)
        if node.is_const:
            return Text(repr(node.value), ATOM if node.value >= 0 else SUM)
        if id(node) in self._texts:
            return self._texts[id(node)]
        text = self._expression(node)
        if self._uses[id(node)] > 1 and node.op is not Op.NEG:
            name = f"_{len(self._texts) + 1}"
            self._line(f"const {name} = {text.code};")
            text = self._texts[id(node)] = Text(name)
        return text

    def _expression(self, node: SolverScalar) -> Text:
        args = [self._text(arg) for arg in node.args]
        if node.op is Op.NEG:
            return Text(f"-{args[0].within(UNARY)}", SUM)
        if node.op in (Op.SQRT, Op.ABS):
            inner = f"Math.max({args[0].code}, 0)" if node.op is Op.SQRT else args[0].code
            return Text(f"Math.{'sqrt' if node.op is Op.SQRT else 'abs'}({inner})")
        if node.op in (Op.ADD, Op.SUB):
            sign = "+" if node.op is Op.ADD else "-"
            return Text(f"{args[0].within(SUM)} {sign} {args[1].within(PRODUCT)}", SUM)
        sign = "*" if node.op is Op.MUL else "/"
        return Text(f"{args[0].within(PRODUCT)}{sign}{args[1].within(UNARY)}", PRODUCT)
