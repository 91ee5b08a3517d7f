"""The Python interface of a compiled robot: NumPy calls with checked arguments, for one state or a batch.

Equation numbers (14.x) are those of Kostic, de Jager and Steinbuch, Modeling and Identification for Robot Motion
Control, chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.model.drive_columns import drive_columns
from rrrgen.model.drive_terms import drive_terms
from rrrgen.program import Port, Role
from rrrgen.runtime.arguments import checked, choose, nominal_values, prepare, read_only
from rrrgen.runtime.bound import BoundFunction
from rrrgen.runtime.engines import Engine
from rrrgen.runtime.results import (
    DynamicsTerms,
    ForwardDynamicsDerivatives,
    InverseDynamicsDerivatives,
    JointLimits,
    Kinematics,
)
from rrrgen.runtime.summary import html_summary

if TYPE_CHECKING:
    import sympy as sp

    from rrrgen.derive.closed_forms.closed_form import ClosedForm
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.robotfile.robot_spec import RobotSpec
    from rrrgen.runtime.inverse_kinematics import IKBatch, IKResult, InverseKinematics

Array = NDArray[Any]


class Model:
    """Kinematics and dynamics of one robot.

    Every function takes a state (n,) or a batch (..., n) of any strides and returns dense float64 arrays (float32 if
    compiled with ``real="float"``). Positions are rad or m, SI throughout. ``beta`` (b,) or (..., b) are the base
    parameters and ``Ia`` (n,) or (..., n) the drive inertias (with coupled drives one for each that the file states, at
    its joint or motor: Ia1, .., Ia_m1, ..); both default to the nominal values of the robot file.
    Wrong shapes raise ValueError, wrong kinds of numbers TypeError.
    """

    def __init__(
        self,
        derived: DerivedModel,
        engine: Engine,
        closed_form: Callable[[str], ClosedForm] | None = None,
        remake: Callable[[], Model] | None = None,
    ) -> None:
        self.derived = derived
        self.engine = engine
        self._closed_form = closed_form
        self._remake = remake
        self.spec: RobotSpec = derived.spec
        self.n: int = derived.spec.n
        self.base_parameters: tuple[sp.Expr, ...] = tuple(p.expression for p in derived.base_parameters)
        self.base_parameter_names: tuple[str, ...] = tuple(p.name for p in derived.base_parameters)
        self.base_projection: Array = read_only(np.array(derived.base_projection, dtype=float))
        self.beta: Array | None = nominal_values(derived.beta_nominal)
        self.drive_inertia: Array | None = nominal_values(derived.drive_inertia_nominal)
        self._terms = drive_terms(derived.spec)
        self._ik: InverseKinematics | None = None

    @property
    def threads(self) -> int:
        """Number of threads that share one batch, 1 by default; calls release the global interpreter lock."""
        return self.engine.threads

    @threads.setter
    def threads(self, count: int) -> None:
        if count < 1:
            raise ValueError(f"threads must be at least 1, not {count}")
        self.engine.threads = count

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
        each = [joint.limits for joint in self.spec.joints]
        lower = [-np.inf if one.lower is None else one.lower for one in each]
        above = {
            key: [np.inf if getattr(one, key) is None else getattr(one, key) for one in each]
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
        """Pickle and copy by the description of the robot, since compiled code belongs to one process."""
        if self._remake is None:
            raise TypeError("this model was made without its description and cannot be copied; use rrrgen.compile")
        return self._remake, (), {"threads": self.threads}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.threads = state["threads"]

    # -- kinematics ----------------------------------------------------------------------------------------------

    def forward_kinematics(self, q: ArrayLike) -> Array:
        """Pose of the tip in the base frame, T_0_n = base A_1 ... A_n tool, (..., 4, 4). Source: (14.5)."""
        return self._call("forward_kinematics", q)

    def link_frames(self, q: ArrayLike) -> Array:
        """Poses of all link frames in the base frame, (..., n, 4, 4)."""
        return self._call("link_frames", q)

    def jacobian(self, q: ArrayLike) -> Array:
        """Geometric Jacobian at the tip, base frame, linear rows first: [v; w] = J dq, (..., 6, n)."""
        return self._call("jacobian", q)

    def link_jacobians(self, q: ArrayLike) -> Array:
        """Geometric Jacobians of all link frames, base frame, linear rows first: [v_i; w_i] = J_i dq, (..., n, 6, n).

        ``J[..., i, :, :]`` is that of the origin of ``link_frames(q)[..., i, :, :]``, without the tool; columns of
        joints beyond the link are zero. A wrench [f; m] at that origin loads the joints with J_i' [f; m].
        """
        return self._call("link_jacobians", q)

    def kinematics(self, q: ArrayLike) -> Kinematics:
        """Pose of the tip T (..., 4, 4) and Jacobian J (..., 6, n), from one evaluation, as a named tuple."""
        return Kinematics(*self.engine.call("kinematics", (q,)))

    def jacobian_dot_dq(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """(dJ/dt) dq, the acceleration of the tip for ddq = 0 in the base frame, linear part first, (..., 6)."""
        return self._call("jacobian_dot_dq", q, dq)

    @property
    def ik(self) -> InverseKinematics:
        """The inverse kinematics with all its options. Raises DerivationError if the arm has no solver.

        It is compiled, or evaluated with the NumPy backend; an elimination for six joints is solved in C only.
        """
        if self._ik is None:
            from rrrgen.runtime.inverse_kinematics import load_solver

            self._ik = load_solver(self.spec, backend=self.engine.name)
        return self._ik

    def inverse_kinematics(
        self,
        target: ArrayLike,
        q_ref: ArrayLike | None = None,
        limits: bool = True,
        sort: Literal["branch", "nearest"] = "branch",
        redundancy: ArrayLike | None = None,
    ) -> IKResult | IKBatch:
        """Every configuration that brings the tip to ``target``: a pose (4, 4), or a position (3,) for up to 3 joints.

        The result of one target has ``q`` (k, n), ``flags`` (k,), ``branches`` (k,), and without a solution the
        ``reason``. A batch of targets (..., 4, 4) or (..., 3) gives an :class:`IKBatch` with ``q`` (..., rows, n) and
        ``counts`` (...). ``q_ref`` (n,) gives free angles, the turn of angles, and the order with ``sort="nearest"``.
        ``limits`` leaves out solutions outside the joint limits. ``redundancy`` is the prescribed joint or arm angle of
        a redundant arm, one number or one for each target, by default its value in ``q_ref``. Source: (14.45), all
        branches.
        """
        goals = np.asarray(target)
        single = (goals.shape[-2:] == (4, 4) and goals.ndim == 2) or goals.shape == (3,)
        if single or goals.shape[-1:] not in ((3,), (4,)):
            return self.ik.solve(target, q_ref, limits=limits, sort=sort, redundancy=redundancy)  # type: ignore[arg-type]
        return self.ik.solve_batch(target, q_ref, limits=limits, sort=sort, redundancy=redundancy)

    # -- dynamics ------------------------------------------------------------------------------------------------

    def mass_matrix(self, q: ArrayLike, beta: ArrayLike | None = None, *, Ia: ArrayLike | None = None) -> Array:
        """Mass matrix M(q) with drive inertia, (..., n, n). Source: (14.7)."""
        return self._call_with("mass_matrix", (q,), beta, Ia)

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """Coriolis matrix C(q, dq) with dM/dt - 2C skew-symmetric, (..., n, n)."""
        return self._call_with("coriolis_matrix", (q, dq), beta)

    def coriolis(self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """Centrifugal and Coriolis torques c = C dq, (..., n). Source: (14.7)."""
        return self._call_with("coriolis", (q, dq), beta)

    def coriolis_transpose(self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """C' dq, for momentum observers, (..., n)."""
        return self._call_with("coriolis_transpose", (q, dq), beta)

    def gravity(self, q: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """Gravity torques g(q), (..., n). Source: (14.7)."""
        return self._call_with("gravity", (q,), beta)

    def bias(self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """Bias torques h = c(q, dq) + g(q), (..., n): the joint torques for ddq = 0, without friction."""
        return self._call_with("bias", (q, dq), beta)

    def dynamics_terms(
        self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None, *, Ia: ArrayLike | None = None
    ) -> DynamicsTerms:
        """M (..., n, n), c and g (..., n) of tau = M ddq + c + g, from one evaluation, as a named tuple."""
        return DynamicsTerms(*self._evaluate("dynamics_terms", (q, dq), beta, Ia))

    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
    ) -> Array:
        """Joint torques of rigid body and drive inertia, tau = M ddq + c + g, (..., n). Source: (14.6)."""
        return self._call_with("inverse_dynamics", (q, dq, ddq), beta, Ia)

    def forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        with_status: bool = False,
    ) -> Any:
        """Joint accelerations ddq = M^-1 (tau - c - g), (..., n).

        Where M is indefinite or singular, numpy.linalg.LinAlgError is raised; with ``with_status=True`` nothing is
        raised and ``(ddq, status)`` returned, status (...) being 0 where M is positive definite and 1 elsewhere.
        """
        status, ddq = self._evaluate("forward_dynamics", (q, dq, tau), beta, Ia)
        return self._checked("forward_dynamics", ddq, status, with_status)

    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
    ) -> InverseDynamicsDerivatives:
        """tau (..., n) with d tau/dq, d tau/d(dq) and d tau/d(ddq) = M, each (..., n, n), as a named tuple."""
        return InverseDynamicsDerivatives(*self._evaluate("inverse_dynamics_derivatives", (q, dq, ddq), beta, Ia))

    def forward_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        with_status: bool = False,
    ) -> Any:
        """ddq (..., n) with its derivatives by q, dq and tau, each (..., n, n), as a named tuple.

        Where M is indefinite or singular: as :meth:`forward_dynamics`; ``with_status=True`` gives
        ``(derivatives, status)``.
        """
        status, *values = self._evaluate("forward_dynamics_derivatives", (q, dq, tau), beta, Ia)
        return self._checked("forward_dynamics_derivatives", ForwardDynamicsDerivatives(*values), status, with_status)

    def energy(
        self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None, *, Ia: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Kinetic and potential energy in J, each (...)."""
        (E,) = self._evaluate("energy", (q, dq), beta, Ia)
        return E[..., 0], E[..., 1]

    def friction(self, dq: ArrayLike) -> Array:
        """Friction torques of the laws of the robot file, zero where it is silent, (..., n). Source: (14.11)-(14.14).

        Laws with a state are taken in sliding. Coupled motors add theirs, S^-T tau_fm(S^-1 dq).
        """
        if "friction" in self.derived.programs:
            return self._call("friction", dq)
        port = Port("dq", (self.n,), meaning="joint velocities", role=Role.VELOCITY)
        return np.zeros_like(prepare("friction", [port], [dq], self.engine.dtype)[1][0])

    def friction_step(self, dq: ArrayLike, z: ArrayLike, period: ArrayLike) -> tuple[Array, ...]:
        """States z (..., s) of the friction laws with one after ``period`` s (...) at constant dq, torques (..., n)."""
        if "friction_step" not in self.derived.programs:
            raise ValueError("no friction law of this robot has a state: friction(dq) states it all")
        return tuple(self.engine.call("friction_step", (dq, z, period)))

    # -- regressors ----------------------------------------------------------------------------------------------

    def regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Y with tau = Y beta (rigid body, without drive inertia), (..., n, b). Source: (14.10)."""
        return self._call("regressor", q, dq, ddq)

    def regressor_transpose(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, e: ArrayLike) -> Array:
        """Y' e without forming Y, for adaptive laws, (..., b). Source: (14.23)."""
        return self._call("regressor_transpose", q, dq, ddq, e)

    def standard_regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Y with tau = Y phi in the standard parameters of all links, (..., n, 10n).

        Per link m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz: first moments and inertia tensor about the origin of the
        link frame, in its axes.
        """
        return self._call("standard_regressor", q, dq, ddq)

    def identification_regressor(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> Array:
        """Base regressor with the columns of drive inertia, friction and offset that the file asks for.

        tau = Y beta + Ia ddq + fv dq + fc sgn(dq) + offset, (..., n, b + extra); columns as in
        ``identification_parameter_names``. These are the columns that `rrrgen identify` fits: sgn(dq) is 0 at speeds
        up to :data:`rrrgen.model.drive_columns.STANDSTILL`, where reconstructed speeds have no sign.
        """
        Y = self.regressor(q, dq, ddq)
        drives = drive_columns(self._terms, np.asarray(dq, dtype=float), np.asarray(ddq, dtype=float))
        wide = np.broadcast_to(drives, (*Y.shape[:-1], len(self._terms)))
        return np.concatenate([Y, wide.astype(Y.dtype)], axis=-1)

    @property
    def identification_parameter_names(self) -> tuple[str, ...]:
        """Names of the columns of :meth:`identification_regressor`."""
        return (*self.base_parameter_names, *(term.name for term in self._terms))

    @property
    def identification_parameters(self) -> Array | None:
        """Nominal values of :attr:`identification_parameter_names`; None without links."""
        return None if self.beta is None else np.concatenate([self.beta, [term.value for term in self._terms]])

    # -- more ----------------------------------------------------------------------------------------------------

    def closed_form(self, name: str) -> ClosedForm:
        """Function ``name`` as exact expressions, trigonometry collected: ``closed_form("mass_matrix")[0, 0]``."""
        if self._closed_form is None:
            raise ValueError("this model was made without its derivation; use rrrgen.compile")
        return self._closed_form(name)

    def casadi_function(self, name: str, smooth_sign: float | None = None) -> Any:
        """Function ``name`` as a ``casadi.Function`` over SX, with exact derivatives, for optimisation.

        Inputs and outputs carry the names of the ports; base parameters are an input where the function takes them.
        ``smooth_sign`` = eps > 0 replaces sgn(x) by tanh(x / eps). Raises BuildError without CasADi.
        """
        if name not in self.derived.programs:
            raise ValueError(f"no function '{name}'; there are {', '.join(sorted(self.derived.programs))}")
        from rrrgen.backends.casadi import function

        return function(self.derived.programs[name], name, smooth_sign)

    def bind(self, name: str, beta: ArrayLike | None = None, *, Ia: ArrayLike | None = None) -> BoundFunction:
        """Function ``name`` with preallocated buffers for one state, for control loops.

        ``f = m.bind("inverse_dynamics"); f.inputs["q"][:] = q; tau = f()``. Parameters are bound too:
        ``f.inputs["beta"]`` where they are taken at run time.
        """
        if name not in self.derived.programs:
            raise ValueError(f"no function '{name}'; there are {', '.join(sorted(self.derived.programs))}")
        chosen, parameters = self._chosen(name, beta, Ia)
        program = self.derived.programs[chosen]
        return BoundFunction(program, self.engine, {key: np.asarray(value) for key, value in parameters.items()})

    def _call(self, name: str, *values: Any) -> Array:
        return self.engine.call(name, values)[0]

    def _call_with(self, name: str, values: tuple[Any, ...], beta: Any, Ia: Any = None) -> Array:
        return self._evaluate(name, values, beta, Ia)[0]

    def _evaluate(self, name: str, values: tuple[Any, ...], beta: Any, Ia: Any) -> Sequence[Array]:
        chosen, parameters = self._chosen(name, beta, Ia)
        return self.engine.call(chosen, (*values, *parameters.values()))

    def _chosen(self, name: str, beta: Any, Ia: Any) -> tuple[str, dict[str, Any]]:
        """The name of the program to run, the nominal specialization if no parameters are given, and its parameters."""
        given = {Role.BASE_PARAMETERS: (beta, self.beta), Role.DRIVE_INERTIA: (Ia, self.drive_inertia)}
        return choose(self.derived.programs, name, given)

    def _checked(self, name: str, result: Any, status: Any, with_status: bool) -> Any:
        """``result`` if no state failed; otherwise LinAlgError, or both for the caller to look at."""
        return checked(self.derived.programs[name], result, status, with_status)
