"""The Python interface of a compiled robot: NumPy calls with checked arguments, for one state or a batch.

Equation numbers (14.x) are those of Kostic, de Jager and Steinbuch, Modeling and Identification for Robot Motion
Control, chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from rrrgen.runtime.arguments import check_positions, read_only
from rrrgen.runtime.display import Drawings, html_summary
from rrrgen.runtime.engines import BoundFunction, Engine
from rrrgen.runtime.functions.calls import Array
from rrrgen.runtime.functions.differential import DifferentialFunctions
from rrrgen.runtime.functions.hessians import HessianFunctions
from rrrgen.runtime.functions.parameters import ParameterFunctions, RegressorFunctions
from rrrgen.runtime.paths import PathFunctions
from rrrgen.runtime.results import JointLimits

if TYPE_CHECKING:
    import sympy as sp
    from numpy.typing import ArrayLike

    from rrrgen.derive.closed_forms import ClosedForm
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit import Real
    from rrrgen.ik.inverse_kinematics import InverseKinematics
    from rrrgen.ik.results import IKBatch, IKResult
    from rrrgen.robot.model.mechanism import TipArm
    from rrrgen.runtime.controller import Controller
    from rrrgen.runtime.loop_positions import LoopEngine


class Model(
    Drawings,
    RegressorFunctions,
    ParameterFunctions,
    DifferentialFunctions,
    HessianFunctions,
    PathFunctions,
):
    """Kinematics and dynamics of one robot, made by :func:`rrrgen.compile`.

    Every function takes a state (n,) or a batch (..., n) of any strides and returns dense float64 arrays (float32 if
    compiled with ``real="float"``). Positions are rad or m, SI throughout. ``beta`` (b,) or (..., b) are the base
    parameters and ``Ia`` (n,) or (..., n) the drive inertias (with coupled drives one for each that the file states, at
    its joint or motor: Ia1, .., Ia_m1, ..); both default to the nominal values of the robot file. Wrong shapes raise
    ValueError, wrong kinds of numbers TypeError.

    Args:
        derived: the programs of the robot's functions, with its base parameters and their nominal values.
        engine: evaluates a program by its name, compiled or with NumPy.
        closed_form: gives the closed form of a function by name; None if the model was made without its derivation.
        compiled: compiles a robot with the same options, for copies, for gravity as an input and for further groups of
            functions; None if that is not known.
    """

    def __init__(
        self,
        derived: DerivedModel,
        engine: Engine,
        closed_form: Callable[[str], ClosedForm] | None = None,
        compiled: Callable[..., Model] | None = None,
    ) -> None:
        super().__init__(derived, engine)
        self._closed_form = closed_form
        self._compiled = compiled
        self.base_parameters: tuple[sp.Expr, ...] = tuple(p.expression for p in derived.base_parameters)
        self.base_projection: Array = read_only(np.array(derived.base_projection, dtype=float))
        self._ik: InverseKinematics | None = None
        self._tip_solvers: dict[str, InverseKinematics] = {}

    @property
    def threads(self) -> int:
        """Number of threads that share one batch, 1 by default; calls release the global interpreter lock."""
        return self.engine.threads

    @threads.setter
    def threads(self, count: int) -> None:
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)):
            raise TypeError(f"threads must be a whole number, at least 1, not {count!r}")
        if count < 1:
            raise ValueError(f"threads must be at least 1, not {count}")
        self.engine.threads = int(count)

    @property
    def name(self) -> str:
        """The name of the robot, which is the prefix of its emitted C symbols."""
        return self.spec.name

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The names of the joints, in the order of q."""
        return tuple(joint.name for joint in self.spec.joints)

    @property
    def limits(self) -> JointLimits:
        """The joint limits of the robot file, each (n,), in SI units; -inf or inf where it states none."""
        limits = [joint.limits for joint in self.spec.joints]
        lower = [-np.inf if one.lower is None else one.lower for one in limits]
        above = {
            key: [np.inf if getattr(one, key) is None else getattr(one, key) for one in limits]
            for key in JointLimits._fields[1:]
        }
        return JointLimits(*(read_only(np.array(values, dtype=float)) for values in (lower, *above.values())))

    def __repr__(self) -> str:
        return f"<rrrgen.Model {self.name}: {self._structure}, {len(self.base_parameters)} base parameters>"

    def _repr_html_(self) -> str:
        """HTML for notebooks: the joints, and the base parameters with their nominal values."""
        return html_summary(self)

    @property
    def _structure(self) -> str:
        return "".join("R" if joint.is_revolute else "P" for joint in self.spec.joints)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy the model by the description of its robot; the receiving process compiles it again."""
        return self._compiler(), (self.spec,), {"threads": self.threads}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.threads = state["threads"]

    # -- loops that Newton's method solves -------------------------------------------------------------------------

    def at_loops(self, loop_q: ArrayLike) -> Model:
        """The same model with the passive joints at ``loop_q``, for a robot whose loops Newton's method solves.

        ``loop_q, _ = m.solve_loops(q, q_last, loop_q); tau = m.at_loops(loop_q).inverse_dynamics(q, dq, ddq)``. Without
        it, functions follow the passive joints from the start of the robot file along a straight line in q, which takes
        far longer.

        Args:
            loop_q: positions of the passive joints at the q of the calls, (p,) or (..., p), rad or m, in the order of
                :attr:`loop_joint_names`.

        Returns:
            The model, which shares all code with this one.

        Raises:
            ValueError: no loop of the robot file has ``solve: newton``.
        """
        return self._at_loops(self._loop_engine("at_loops").at(np.asarray(loop_q)))

    def loop_positions(self, q: ArrayLike) -> Array:
        """The positions of the passive joints at ``q``, of a robot whose loops Newton's method solves.

        They are followed from the start of the robot file along a straight line in q, and are those of the same way to
        assemble the loops unless it passes a dead point. Where the loops cannot be assembled the result is finite, and
        ``closed_loops`` reports it.

        Args:
            q: joint positions, (..., n), rad or m.

        Returns:
            Positions (..., p), rad or m, in the order of :attr:`loop_joint_names`.

        Raises:
            TypeError: ``q`` holds no real numbers.
            ValueError: no loop of the robot file has ``solve: newton``, or a wrong shape.
        """
        engine = self._loop_engine("loop_positions")
        return engine.followed().at(check_positions("loop_positions", q, self.n))

    @property
    def loop_joint_names(self) -> tuple[str, ...]:
        """The names of the passive joints of closed loops, in the order of the loops."""
        passive = () if self.spec.mechanism is None else self.spec.mechanism.passive
        return tuple(self.spec.rows[row].name for row in passive)

    def _loop_engine(self, function: str) -> LoopEngine:
        from rrrgen.runtime.loop_positions import LoopEngine

        if not isinstance(self.engine, LoopEngine):
            raise ValueError(f"{function}: no loop of the robot file has solve: newton")
        return self.engine

    def _at_loops(self, engine: LoopEngine) -> Model:
        """The same model with ``engine``, whose passive joints further compiled functions take too."""
        compiled = self._compiled and partial(_compile_at_loops, self._compiled, engine.loop_q)
        return Model(self.derived, engine, self._closed_form, compiled)

    @property
    def _real(self) -> Real:
        """The floating-point type of the C code."""
        return "double" if self.engine.dtype == np.float64 else "float"

    # -- inverse kinematics --------------------------------------------------------------------------------------

    @property
    def ik(self) -> InverseKinematics:
        """The inverse kinematics of the robot as an object with all options. Raises DerivationError without a solver.

        It is compiled when first used, or evaluated in Python with the NumPy backend.
        """
        if self._ik is None:
            from rrrgen.runtime.inverse_kinematics import load_solver

            self._ik = load_solver(self.spec, backend=self.engine.name, real=self._real)
        return self._ik

    def inverse_kinematics(
        self,
        target: ArrayLike,
        q_ref: ArrayLike | None = None,
        limits: bool = True,
        sort: Literal["branch", "nearest"] = "branch",
        redundancy: ArrayLike | None = None,
        tool: ArrayLike | None = None,
        *,
        tip: str | None = None,
    ) -> IKResult | IKBatch:
        """Every configuration that brings the tip to ``target``: one target, or a batch. Source: (14.45), all branches.

        Args:
            target: pose of the tip in the base frame, (..., 4, 4), or its position, (..., 3), m, for arms of up to
                three joints.
            q_ref: reference configuration, (n,), rad or m: it gives angles that are free at singular configurations,
                the full turns of angles, and the order with ``sort="nearest"``.
            limits: leave out solutions outside the joint limits.
            sort: "branch" keeps the order of the branches, "nearest" puts the solution nearest to ``q_ref`` first.
            redundancy: the prescribed joint or arm angle of a redundant arm, rad or m, one number or one for each
                target, (...); by default its value in ``q_ref``.
            tool: pose of a tool in the last link frame, (4, 4) or (..., 4, 4), in place of that of the robot file: the
                target is then the pose or the position of this tool.
            tip: a named tip of the robot file in place of the unnamed one. It is solved for by the joints that move it
                alone; those that it shares with other tips, and joints that do not move it, are as in ``q_ref``.

        Returns:
            For one target an :class:`IKResult` with ``q`` (k, n), ``flags`` (k,), ``branch`` (k,), and without a
            solution the ``reason``; for a batch an :class:`IKBatch` with ``q`` (..., k_max, n) and ``counts`` (...).

        Raises:
            DerivationError: the arm has no solver, or ``redundancy`` is given to an arm that is not redundant.
            ValueError: a wrong shape, an unknown ``sort`` or ``tip``, a redundant arm without ``redundancy`` and
                ``q_ref``, or a tip with shared joints without ``q_ref``.
        """
        if tip is not None:
            return self._ik_at_tip(tip, target, q_ref, tool, limits=limits, sort=sort, redundancy=redundancy)
        solver = self.ik
        if tool is not None and solver.plan.task == "position":
            solver, target = self._tool_solver, _with_position(target, tool)
        elif tool is not None:
            if np.shape(target)[-2:] != (4, 4):
                raise ValueError("tool: needs poses (..., 4, 4) as targets, since this arm is solved for poses")
            target = self.tool_target(target, tool)
        return _solve(solver, target, q_ref, limits=limits, sort=sort, redundancy=redundancy)

    def tip_arm(self, tip: str) -> TipArm:
        """The joints that move a named tip and no tip beside it, for which its inverse kinematics solves.

        Args:
            tip: the name of the tip in the robot file.

        Returns:
            The robot of these joints, their numbers in q, and those of the joints that the tip shares with others.

        Raises:
            DerivationError: no joint moves the tip alone, or joints that tips share stand behind such ones.
            ValueError: the robot has no such tip.
        """
        from rrrgen.robot.model.mechanism import tip_arm

        self._at_tip("inverse_kinematics", tip)
        return tip_arm(self.spec, tip)

    def tip_ik(self, tip: str) -> InverseKinematics:
        """The inverse kinematics of a named tip as an object with all options.

        It is the solver that is called ``<name>_<tip>_inverse_kinematics`` in C.

        Args:
            tip: the name of the tip in the robot file.

        Returns:
            The solver for the joints that move this tip and none beside it. Its targets are in the frame of the link
            that carries them: those of :meth:`tip_target` where the tip shares joints with others, else in the base.

        Raises:
            DerivationError: no solver fits these joints.
            ValueError: the robot has no such tip.
        """
        from rrrgen.runtime.inverse_kinematics import load_solver

        arm = self.tip_arm(tip)
        if tip not in self._tip_solvers:
            self._tip_solvers[tip] = load_solver(arm.spec, backend=self.engine.name, real=self._real)
        return self._tip_solvers[tip]

    def _ik_at_tip(
        self, tip: str, target: ArrayLike, q_ref: ArrayLike | None, tool: ArrayLike | None, **options: Any
    ) -> IKResult | IKBatch:
        """Solve for a named tip by the joints that move it alone; the others are in the solutions as in ``q_ref``."""
        solver, arm = self.tip_ik(tip), self.tip_arm(tip)
        whole = np.zeros(self.n) if q_ref is None else np.asarray(q_ref, dtype=float)
        if whole.shape != (self.n,):
            raise ValueError(f"q_ref must hold {self.n} numbers, not shape {whole.shape}")
        if tool is not None:
            if np.shape(target)[-2:] != (4, 4):
                raise ValueError("tool: needs poses (..., 4, 4) as targets at a named tip")
            target = self.tool_target(target, tool, tip=tip)
        if arm.shared:
            if q_ref is None:
                names = ", ".join(self.joint_names[k] for k in arm.shared)
                raise ValueError(
                    f"inverse_kinematics: tip {tip!r} needs q_ref, which holds {names}, shared with other tips"
                )
            target = self._in_carrier(target, whole, tip)
        joints = list(arm.joints)
        solution = _solve(solver, target, None if q_ref is None else whole[joints], **options)
        q = np.where(np.isnan(solution.q[..., :1]), np.nan, whole)
        q[..., joints] = solution.q
        return replace(solution, q=q)

    def _in_carrier(self, target: ArrayLike, q: Array, tip: str) -> Array:
        """Targets in the frame of the link that carries the own joints of ``tip``: poses or positions, as given."""
        goal = np.asarray(target, dtype=float)
        if goal.shape[-2:] == (4, 4):
            return np.asarray(self.tip_target(goal, q, tip=tip))
        if goal.shape[-1:] != (3,):
            raise ValueError(f"target must hold positions (..., 3) or poses (..., 4, 4), not shape {goal.shape}")
        pose = np.tile(np.eye(4), (*goal.shape[:-1], 1, 1))
        pose[..., :3, 3] = goal
        return np.asarray(self.tip_target(pose, q, tip=tip))[..., :3, 3]

    @cached_property
    def _tool_solver(self) -> InverseKinematics:
        """The inverse kinematics of positions with the tool as an input."""
        from rrrgen.runtime.inverse_kinematics import load_tool_solver

        return load_tool_solver(self.spec, backend=self.engine.name, real=self._real)

    # -- more ----------------------------------------------------------------------------------------------------

    def closed_form(self, name: str) -> ClosedForm:
        """The function ``name`` as exact SymPy expressions with collected trigonometry.

        Args:
            name: a function of the model such as "mass_matrix"; of a function with several results, name one:
                "dynamics_terms.c".

        Returns:
            The closed form: ``form[0, 0]`` is one entry, ``form.matrix()`` all of them.

        Raises:
            DerivationError: the function has no closed form.
        """
        if self._closed_form is None:
            raise ValueError("this model was made without its derivation; use rrrgen.compile")
        return self._closed_form(name)

    def casadi_function(self, name: str, smooth_sign: float | None = None, *, hessian: bool = False) -> Any:
        """The function ``name`` as a ``casadi.Function`` over SX, with exact derivatives, for optimisation.

        Args:
            name: a function of the model such as "inverse_dynamics", its specialization "inverse_dynamics_nominal", or
                "inverse_kinematics", which takes ``target``, ``branch_signs``, the sign of every choice between two
                branches (+1 or -1), and, for a redundant arm, ``redundancy``, and gives the one configuration ``q`` of
                that branch; "tool_inverse_kinematics" for positions of a tool, with six numbers as target: its
                position in the base frame, then in the last link frame. Functions of a named tip begin with its name,
                "left_jacobian"; the target of "left_inverse_kinematics" is that of :meth:`tip_target`.
            smooth_sign: eps > 0, in rad/s or m/s, replaces sgn(x) by tanh(x / eps); by default sgn is exact, with
                derivative 0.
            hessian: take first and second derivatives from the functions of rrrgen, such as
                "inverse_dynamics_hessian_nominal", where the Function is called with MX. A solver that asks CasADi for
                exact Hessians then computes a fifth of the operations. For "inverse_dynamics_nominal" and
                "forward_dynamics_nominal"; needs CasADi 3.6 or newer.

        Returns:
            A Function whose inputs and outputs carry the names of the method's arguments and results: ``q``, ``dq``,
            ``beta``, .., ``tau``. A vector is a column; a stack of matrices, (m, r, c), is one matrix, (m r, c), with
            each below the one before. A function that can fail has the output ``status`` as its last one.

        Raises:
            BuildError: CasADi is not installed.
            DerivationError: the inverse kinematics of this arm has no formula for each branch.
            ValueError: there is no function of this name, or eps is not positive, or there is no Hessian of it.
        """
        tip = name.removesuffix("_inverse_kinematics")
        if name in ("inverse_kinematics", "tool_inverse_kinematics") or tip in self.spec.tips:
            from rrrgen.emit.casadi.function import import_casadi
            from rrrgen.emit.casadi.inverse_kinematics import branch_function

            import_casadi()
            spec = self.tip_arm(tip).spec if tip in self.spec.tips else self.spec
            return branch_function(spec, tool=name.startswith("tool_"))
        program = self._with(name).derived.programs[name]
        from rrrgen.emit.casadi.function import function

        made = function(program, name, smooth_sign)
        if not hessian:
            return made
        from rrrgen.emit.casadi.files import derivative_functions
        from rrrgen.emit.casadi.own_derivatives import with_own_derivatives

        models = (*self.parts, self._with("inverse_dynamics_hessian"))
        programs = {program_name: one for model in models for program_name, one in model.derived.programs.items()}
        derivatives = derivative_functions(program, programs)
        if derivatives is None:
            known = ", ".join(
                program_name for program_name in programs if derivative_functions(programs[program_name], programs)
            )
            raise ValueError(f"{name}: no Hessian; functions without parameters have one: {known or 'none here'}")
        return with_own_derivatives(
            made, *(function(programs[program_name], program_name) for program_name in derivatives)
        )

    def bind(self, name: str, beta: ArrayLike | None = None, *, Ia: ArrayLike | None = None) -> BoundFunction:
        """The function ``name`` with preallocated buffers for one state, for control loops.

        ``f = m.bind("inverse_dynamics"); f.inputs["q"][:] = q; tau = f()``.

        Args:
            name: a function of the model such as "inverse_dynamics".
            beta: base parameters, (b,), SI units, copied into ``f.inputs["beta"]``; by default those of the robot file,
                folded into the code.
            Ia: drive inertias, (n,), kg m^2 or kg, copied behind them in ``f.inputs["beta"]``; by default those of the
                robot file.

        Returns:
            The bound function. Its parameters may be changed later where they are among its ``inputs``. So may the
            passive joints of loops that Newton's method solves, ``f.inputs["loop_q"]``, (p,), rad or m: they do not
            follow q. At first they are those of :meth:`at_loops`, without it those at the start of the robot file.

        Raises:
            TypeError: the parameters are no real numbers.
            ValueError: there is no function of this name, or it does not take the parameters, or they are not of one
                state, with the shapes above.
        """
        model = self._with(name)
        chosen, parameters = model._choose_program(name, beta, Ia)
        if not parameters and not (beta is None and Ia is None):
            raise ValueError(f"{name} takes no base parameters, so beta= and Ia= have no meaning")
        known: dict[str, Any] = {"gravity": self.nominal_gravity, **parameters}
        if self.spec.newton:
            engine = self._loop_engine("bind")
            known["loop_q"] = engine.followed().start if engine.loop_q is None else engine.loop_q
        return BoundFunction(model.derived.programs[chosen], model.engine, known)

    def controller(
        self,
        mode: str | None = None,
        *,
        modes: Sequence[str] | None = None,
        parts: Sequence[str] | None = None,
        **parameters: Any,
    ) -> Controller:
        """The controller of the robot as one unit, in compiled C: gates, modes, observer, faults, one call a period.

        ``c = m.controller("computed_torque"); c.start(q=q, dq=dq); out = c.step(q=q, dq=dq, q_d=q_d); out.tau``. It is
        the unit that ``rrrgen generate --with controller`` writes.

        Args:
            mode: the mode of the first tick; ``step(mode=...)`` changes it.
            modes: names of modes to have; by default all that the robot can have.
            parts: names of optional parts, such as "kalman"; by default the observer, friction and payload.
            parameters: parameters of the controller by name, such as ``kp``; by default limits of the robot file and
                untuned gains.

        Returns:
            The controller, with ``start``, ``step``, ``run``, ``set`` and ``reset``.

        Raises:
            InputError: a mode or part is unknown, or the robot cannot have it.
            ValueError: a parameter is unknown or wrong.
            BuildError: the model has no compiler (backend="numpy").
        """
        from rrrgen.base.errors import BuildError
        from rrrgen.runtime.controller import compiled_controller

        if self.engine.name != "c":
            raise BuildError("controller runs compiled C, and this model was made with backend='numpy'")
        return compiled_controller(self.spec, self._real, mode, modes, parts, parameters)


def _compile_at_loops(compiled: Callable[..., Model], loop_q: Array, *args: Any, **options: Any) -> Model:
    """A model that ``compiled`` makes, with the passive joints at ``loop_q``. No closure: those are not pickled."""
    return compiled(*args, **options).at_loops(loop_q)


def _solve(solver: InverseKinematics, target: ArrayLike, q_ref: ArrayLike | None, **options: Any) -> IKResult | IKBatch:
    """The solutions of one target, or of a batch, as its shape says."""
    goals = np.asarray(target)
    single = (goals.shape[-2:] == (4, 4) and goals.ndim == 2) or goals.shape in ((3,), (6,))
    if single or goals.shape[-1:] not in ((3,), (4,), (6,)):
        return solver.solve(target, q_ref, **options)
    return solver.solve_batch(target, q_ref, **options)


def _with_position(target: ArrayLike, tool: ArrayLike) -> Array:
    """Targets (..., 6) of a solver with the tool as an input: positions, or those of poses, and those of tools."""
    goal, frame = np.asarray(target, dtype=float), np.asarray(tool, dtype=float)
    if frame.shape[-2:] != (4, 4):
        raise ValueError(f"tool must be a pose (..., 4, 4), not of shape {frame.shape}")
    place = goal[..., :3, 3] if goal.shape[-2:] == (4, 4) else goal
    if place.shape[-1:] != (3,):
        raise ValueError(f"target must hold positions (..., 3) or poses (..., 4, 4), not shape {goal.shape}")
    batch = np.broadcast_shapes(place.shape[:-1], frame.shape[:-2])
    return np.concatenate([np.broadcast_to(x, (*batch, 3)) for x in (place, frame[..., :3, 3])], axis=-1)
