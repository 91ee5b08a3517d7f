"""Closed-loop output error of one joint: refines the estimates of `rrrgen experiment friction`.

That estimate is by multiple shooting: it simulates short windows that each start from the measured state and use the
recorded torque. The refinement simulates controller and joint over the whole recording from the reference alone,
through standstill and reversals, as the model will be used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.closed_loop.controller import LoopController
from rrrgen.lab.closed_loop.loop import CompiledLoop, bristle_ports, friction_inputs
from rrrgen.lab.closed_loop.loop_recording import LoopRecording, loop_recordings
from rrrgen.lab.closed_loop.output_error import OutputErrorProblem
from rrrgen.lab.closed_loop.validation import LoopScore, Replay, as_json, loop_score, replay_controller
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.data.uniform_stream import Part
from rrrgen.lab.friction.candidate_laws import Candidate
from rrrgen.lab.friction.estimation import FrictionEstimate, LawEstimate, reported_values
from rrrgen.lab.friction.joint_recording import CUTOFF
from rrrgen.lab.friction.joint_simulation import Directed
from rrrgen.program import Builder, Port, Program, Role

STEP = 1e-3  # step of finite differences, relative to the parameter, or absolute for a logarithm
SMALLEST = 0.05  # smallest parameter magnitude to which the step is relative

Tell = Callable[[int, int, str], None]


@dataclass(frozen=True)
class JointEquations:
    """Equation of motion of one joint, ``J ddq = tau - gravity - tau_f``, with the friction law of ``candidate``.

    The parameters are those of the candidate in its order, except the time delay, which the controller states.
    """

    candidate: Candidate

    n = 1
    carried = None

    @property
    def bent(self) -> tuple[bool]:
        """Whether the friction law has a state."""
        return (self.candidate.law.rate is not None,)

    @property
    def size(self) -> int:
        """Number of parameters of the equation of motion; the time delay is not among them."""
        return len(self.candidate.names) - 1

    @property
    def directions(self) -> Array:
        """Matrix (1, 1) that maps the joint speed to the sliding speed of the only friction surface: 1."""
        return np.ones((1, 1))

    def programs(self) -> tuple[Program, ...]:
        """Programs of the equation of motion: ``terms`` gives inertia and gravity torque, ``friction`` the friction.

        ``friction`` takes the sliding speed and, separately, the direction of sliding (+1 or -1); for a law with a
        state it also gives :func:`bristle_ports`.
        """
        builder = Builder()
        q = builder.input(Port("q", (1,), "rad | m", "joint", "position", Role.POSITION))
        builder.input(Port("dq", (1,), "rad/s | m/s", "joint", "velocity", Role.VELOCITY))
        theta = builder.input(Port("theta", (self.size,), "mixed", "", "parameters"))
        load = self.candidate.gravity_torque(q[0], theta, builder)
        outputs = [(Port("M", (1, 1), "kg m^2", "joint", "inertia"), [theta[0]])]
        outputs += [(Port("load", (1,), "N m | N", "joint", "gravity torque"), [load])]
        terms = builder.program("terms", outputs, summary="Inertia and load of the joint.")
        builder = Builder()
        u, d, s, _ = friction_inputs(builder, 1)
        theta = builder.input(Port("theta", (self.size,), "mixed", "", "parameters"))
        values = self.candidate.law_values([*theta, 0])
        law = self.candidate.law
        port = Port("f", (1,), "N m | N", "", "friction")
        at = Directed(builder, d[0] if law.rate is None else s[0])
        outputs = [(port, [law.torque(at, u[0], values)])]
        if law.bristles is not None:
            bristles = law.bristles(Directed(builder, d[0]), u[0], values)
            outputs += [(bristle_port, [value]) for bristle_port, value in zip(bristle_ports(1), bristles, strict=True)]
        friction = builder.program("friction", outputs, summary="Friction in a given direction.")
        return terms, friction


@dataclass(frozen=True)
class _LawParameters:
    """Maps the optimizer's unconstrained variables z, some of them logarithms, to the parameters of a friction law."""

    candidate: Candidate

    def theta(self, z: Array) -> Array:
        return self.candidate.clip(self.candidate.from_free(np.append(z, 0.0)))[:-1]

    def steps(self, z: Array) -> Array:
        return np.where(self.logarithms(z), STEP, STEP * np.maximum(np.abs(z), SMALLEST))

    def logarithms(self, z: Array) -> NDArray[np.bool_]:
        return self.candidate.is_logarithmic[: len(z)]


@dataclass(frozen=True, eq=False)
class LoopRefinement:
    """Friction estimate refined by closed-loop output error, with the evidence for it.

    ``replay`` compares the controller's torques, computed from the measured motion, with the recorded ones. ``before``
    and ``after`` are the scores of the simulated loop before and after the refinement, ``first`` the parameters before
    it (name -> value).
    """

    estimate: FrictionEstimate
    replay: Replay
    before: LoopScore
    after: LoopScore
    first: dict[str, float]

    def lines(self) -> list[str]:
        """Lines of text for the report: the check of the controller and the scores before and after."""
        names = [self.estimate.data.name]
        return [self.replay.line(names), self.before.line(names), self.after.line(names)]

    def to_json(self) -> dict[str, Any]:
        """Plain data for JSON: the check of the controller, the scores, and the parameters before the refinement."""
        return {
            "controller_error": self.replay.errors[0],
            "before": as_json(self.before),
            "after": as_json(self.after),
            "multiple_shooting": self.first,
        }


def refine(
    estimate: FrictionEstimate,
    log: Log,
    controller: LoopController,
    progress: Tell | None = None,
) -> LoopRefinement:
    """Refine a friction estimate of one joint by closed-loop output error.

    The chosen law of ``estimate``, from the recording ``log``, is refined. ``controller`` may describe
    several joints; only the controller of this joint is used. ``progress`` is called with messages. Raises InputError
    if ``controller`` lacks the joint, DerivationError if the simulated loop diverges.
    """
    name, law = estimate.data.name, estimate.chosen
    joints = [joint for joint in controller.joints if joint.name == name]
    if not joints:
        raise InputError(f"the controller has no joint '{name}'; it has {', '.join(controller.names)}")
    single = replace(controller, joints=tuple(joints))
    processing = Processing("butterworth", cutoff=min(CUTOFF, 0.2 / log.period))
    recordings = loop_recordings([_OneJoint(log, log.joints.index(name))], single, processing)
    loop = CompiledLoop(JointEquations(law.candidate), single)
    check = replay_controller(loop, recordings)
    work = OutputErrorProblem(loop, _LawParameters(law.candidate), recordings, [r.scored for r in recordings])
    start = law.theta[:-1]
    try:
        fit = work.fit(law.candidate.to_free(law.theta)[:-1], progress or (lambda done, total, message: None))
    except DerivationError as error:
        raise DerivationError(f"{error}; {check.line([name])}") from None
    theta = work.parameters.theta(fit.z)
    before = _score("before the refinement", loop, start, recordings)
    after = _score("refined", loop, theta, recordings)
    again = _with_refined_parameters(law, theta, work.covariance(fit), estimate.data.period)
    laws = tuple(again if law_estimate is law else law_estimate for law_estimate in estimate.laws)
    return LoopRefinement(replace(estimate, laws=laws, chosen=again), check, before, after, law.values)


def _score(data: str, loop: CompiledLoop, theta: Array, recordings: Sequence[LoopRecording]) -> LoopScore:
    score, _ = loop_score(data, loop, theta, recordings, lambda r: np.ones(len(r), bool))
    assert score is not None
    return score


def _with_refined_parameters(law: LawEstimate, theta: Array, covariance: Array, period: float) -> LawEstimate:
    """Copy of ``law`` with the refined parameters ``theta`` (k,); ``period`` (s) is that of the controller.

    Standard deviations follow from ``covariance``, that of the optimizer's variables, by the delta method.
    """
    whole = np.append(theta, law.theta[-1])
    values = reported_values(law.candidate, whole, period)
    logs = law.candidate.is_logarithmic[:-1]
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * np.where(logs, theta, 1.0)
    std = dict(zip(law.candidate.names[:-1], spread.tolist(), strict=True))
    if law.candidate.gravity >= 2:
        size = max(values["gravity"], 1e-12)
        J = np.array([[theta[1], theta[2]], [-theta[2] / size, theta[1] / size]]) / size
        both = np.sqrt(np.maximum(np.diag(J @ covariance[1:3, 1:3] @ J.T), 0.0))
        std |= {"gravity": float(both[0]), "gravity_angle": float(both[1])}
    if law.candidate.constant_coefficient is not None:
        std[law.candidate.constant] = std[law.candidate.constant_coefficient]
    return replace(law, theta=whole, values=values, std={k: std.get(k, law.std.get(k, 0.0)) for k in values})


class _OneJoint:
    """View of a recording that contains only one of its joints."""

    def __init__(self, log: Log, joint: int) -> None:
        self._log, self._joint = log, slice(joint, joint + 1)
        self.joints = (log.joints[joint],)
        self.period, self.span, self.repairs, self.mapping = log.period, log.span, log.repairs, log.mapping

    def __len__(self) -> int:
        return len(self._log)

    def parts(self) -> Any:
        """The uninterrupted stretches of the recording, each with the columns of this joint only."""
        for part in self._log.parts():
            columns: dict[str, Any] = {
                name: None if getattr(part, name) is None else getattr(part, name)[:, self._joint]
                for name in ("q", "dq", "ddq", "tau", "valid", "reference", "reference_velocity", "feedforward")
            }
            yield Part(t=part.t, segment=part.segment, first=part.first, **columns)

    samples = parts
