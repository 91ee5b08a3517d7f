"""The robot as its user described it: frozen, validated, exact, in SI and radians; names that it may have."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import sympy as sp

from rrrgen.base.errors import Fault, InternalError

# ------------------------------------------------------------------------------------------------------------------
# Rules for the names of robots, joints, motors and parameters.
# ------------------------------------------------------------------------------------------------------------------

MAX_NAME = 40  # the prefix leaves room for the longest function name within C99's 63 significant characters


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_C_KEYWORDS = _words("""auto break case char const
continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
alignas alignof bool complex constexpr false imaginary noreturn nullptr thread_local true typeof""")

_CPP_KEYWORDS = _words("""and and_eq asm atomic_cancel atomic_commit atomic_noexcept bitand bitor catch char8_t char16_t
char32_t class co_await co_return co_yield compl concept consteval constinit const_cast decltype delete dynamic_cast
explicit export final friend import module mutable namespace new noexcept not not_eq operator or or_eq override private
protected public reflexpr reinterpret_cast requires static_assert static_cast template this throw try typeid typename
using virtual wchar_t xor xor_eq""")

# a robot's name is also the name of its header and of its Python module; here are those that exist already
_HEADERS = _words("""assert complex ctype errno
fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg
stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype unistd
windows""")
_MODULES = _words("std casadi numpy sympy scipy rrrgen test main")

_DEVICES = _words("con prn aux nul conin conout clock") | {f"{port}{k}" for port in ("com", "lpt") for k in range(10)}
"""Names that Windows keeps for devices, with any suffix: there is no file con.h."""

_C_LIBRARY = _words("""abs acos acosh asin
asinh atan atan2 atanh cbrt ceil copysign cos cosh erf erfc exp exp2 expm1 fabs
fdim floor fma fmax fmin fmod frexp hypot isfinite isinf isnan isnormal ldexp lgamma log log10
log1p log2 logb lrint lround modf nan nearbyint nextafter pow remainder remquo rint round scalbln scalbn signbit sin
sinh sqrt tan tanh tgamma trunc NAN INFINITY M_PI NULL errno malloc free calloc realloc memcpy memset memmove printf
puts rand srand real_t double_t float_t casadi_real casadi_int casadi_sq casadi_fmin casadi_fmax""")

_TIP_WORDS = _words("floating forward inverse point position tool")
"""Words that make the name of another function of a function of the tip, as forward makes forward_kinematics."""

_STATE = _words("q dq ddq tau beta phi pi E I")
_NUMBERED = re.compile(r"(d{0,2}q|tau|m|mx|my|mz|x|y|z|I[xyz]{2}|Ia|fv|fc)\d+")
_BASE_PARAMETER = re.compile(r"(m|h[xyz]|[IJ][xyz]{2})\d+R")
_ADDED_COLUMN = re.compile(r"off\d+")

KEYWORDS = _C_KEYWORDS | _CPP_KEYWORDS
ROBOT_RESERVED = _HEADERS | _MODULES | _C_LIBRARY
PARAMETER_RESERVED = _C_LIBRARY | _STATE

IDENTIFIER = rf"^[A-Za-z][A-Za-z0-9_]{{0,{MAX_NAME - 1}}}$"


def name_fault(name: str, role: str) -> tuple[str, str] | None:
    """Message and hint if ``name`` is not allowed; None if it is.

    ``role`` is "robot", "joint", "motor", "tip", "tool", "loop", "parameter" or "base parameter".
    """
    shown = name if len(name) <= MAX_NAME else name[:MAX_NAME] + "..."
    if len(name) > MAX_NAME:
        return f"the {role} name '{shown}' is too long", f"at most {MAX_NAME} characters"
    if re.fullmatch(IDENTIFIER, name) is None:
        better = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
        hint = "letters, digits and _, beginning with a letter"
        if re.fullmatch(IDENTIFIER, better):
            hint += f", e.g. {better}"
        return f"the {role} name '{shown}' is not an identifier", hint
    if role == "robot" and ("__" in name or name.endswith("_")):
        return (
            f"the robot name '{name}' makes names with two underscores in a row, which C++ and CasADi refuse",
            f"e.g. {robot_identifier(name)}",
        )
    if name in KEYWORDS:
        return f"the {role} name '{name}' is a keyword of C or C++", f"e.g. {name}_1"
    if keyword.iskeyword(name):
        return f"the {role} name '{name}' is a keyword of Python", f"e.g. {name}_1"
    if name.lower() == "null":  # without quotes, as robot files are written
        return f"the {role} name '{name}' stands for no value in YAML", f"e.g. {name}_1"
    if name.startswith("casadi"):
        return f"the {role} name '{name}' is reserved by CasADi", f"e.g. my_{name}"
    if role == "robot" and name.lower() in _DEVICES:
        return f"the robot name '{name}' is a device of Windows, where no file can be called so", f"e.g. {name}_robot"
    if role == "robot" and (name in ROBOT_RESERVED or name.lower() in _HEADERS):  # file names without case: Math.h
        return f"the robot name '{name}' is taken by a C header or library function", f"e.g. {name}_robot"
    if role == "base parameter" and (name in _STATE or _NUMBERED.fullmatch(name) or _ADDED_COLUMN.fullmatch(name)):
        hint = f"a name of its own, e.g. {name}R or p1; link symbols, drive terms and variables are taken"
        return f"the base parameter name '{name}' is that of a standard parameter or variable", hint
    if role == "tip" and (name.rpartition("_")[2] in _TIP_WORDS or name.startswith("any_gravity")):
        return f"the tip name '{name}' makes names of functions that exist already", f"e.g. {name}_tip"
    if role == "parameter" and _BASE_PARAMETER.fullmatch(name):
        return f"the parameter name '{name}' is reserved", "m1R, hx1R, Jxx1R, Izz1R and the like are base parameters"
    if role == "parameter" and (name in PARAMETER_RESERVED or _NUMBERED.fullmatch(name)):
        hint = "q1, dq1, m1, x1, Ixx1 and the like are joint variables and link symbols; C functions are reserved too"
        return f"the parameter name '{name}' is reserved", hint
    return None


def identifier(text: str) -> str:
    """Turn ``text`` into a C identifier: other characters are replaced; empty if it has no usable character."""
    word = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_")[:MAX_NAME]
    return f"_{word}" if word[:1].isdigit() else word


def robot_identifier(text: str) -> str:
    """Turn ``text`` into a C identifier to which ``_name`` can be added: without two underscores in a row."""
    return re.sub(r"__+", "_", identifier(text)).rstrip("_")


# ------------------------------------------------------------------------------------------------------------------
# The robot as its user described it: frozen, validated, exact, in SI units and radians.
#
# Lengths are in m, angles in rad, masses in kg, inertias in kg m^2. Geometry is exact: every number is a SymPy
# expression over rationals, pi, and the named parameters (real symbols of the same name, see
# :func:`parameter_symbol`).
# ------------------------------------------------------------------------------------------------------------------

Convention = Literal["standard", "modified"]
JointType = Literal["revolute", "prismatic"]


def parameter_symbol(name: str) -> sp.Symbol:
    """The symbol that stands for a named parameter in exact expressions."""
    return sp.Symbol(name, real=True)


@dataclass(frozen=True)
class Limits:
    """Limits of one joint in SI, None if not stated.

    Positions ``lower``, ``upper`` in rad (m), ``velocity`` in rad/s (m/s), ``acceleration`` in rad/s^2 (m/s^2) and
    ``torque`` in N m (N), with the units of a prismatic joint in parentheses.
    """

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    acceleration: float | None = None
    torque: float | None = None


@dataclass(frozen=True)
class LawSpec:
    """A friction law of :data:`rrrgen.robot.friction.laws.LAWS`: its ``name``, and ``values`` of all its parameters in
    order.

    SI units of the joint or motor: N m and rad, or N and m.
    """

    name: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class FrictionSpec:
    """Friction of a joint or motor: ``tau_f = viscous*dq + coulomb*sgn(dq) + offset``, or ``law(dq) + offset``.

    A field that is ``None`` is not part of the model; a field that is given (0 included) adds its column to the
    identification regressor. With a ``law``, ``viscous`` and ``coulomb`` are None.
    """

    viscous: float | None = None
    coulomb: float | None = None
    offset: float | None = None
    law: LawSpec | None = None


@dataclass(frozen=True)
class DriveSpec:
    """The drive of one joint, all values at the joint; None if not stated.

    ``inertia`` Ia, kg m^2 (kg); ``gear_ratio``, motor turns per joint turn; ``torque_constant``, N m/A (N/A);
    ``encoder_resolution``, rad (m); ``stiffness``, N m/rad (N/m), and ``damping``, N m s/rad (N s/m), between rotor and
    link of an elastic joint.
    """

    inertia: float | None = None
    gear_ratio: float | None = None
    torque_constant: float | None = None
    encoder_resolution: float | None = None
    stiffness: float | None = None
    damping: float | None = None


@dataclass(frozen=True)
class MotorSpec:
    """One motor of coupled drives. All values are at the motor's shaft; it makes ``gear_ratio`` turns per drive turn.

    ``name`` names the motor. ``inertia`` (kg m^2), ``friction`` and the largest torque ``torque_limit`` (N m) have the
    units of a joint of the same ``type``; for a linear motor kg and N. A field that is ``None`` is not part of the
    model.
    """

    name: str
    type: JointType = "revolute"
    gear_ratio: sp.Expr = sp.S.One
    inertia: float | None = None
    friction: FrictionSpec | None = None
    torque_limit: float | None = None


@dataclass(frozen=True)
class DrivesSpec:
    """Coupled drives: joint speeds are ``joint_from_drive`` (n x n, exact, regular) times the speeds of the drives.

    ``motors`` (n) are the motors in the order of the columns. With ``S = joint_from_drive diag(1/gear_ratio)``,
    ``dq = S dq_m`` and ``tau = S^-T tau_m``; the motors add ``S^-T (Ia ddq_m + friction(dq_m))`` to the joint torques
    and ``S^-T diag(Ia) S^-1`` to the mass matrix.
    """

    joint_from_drive: tuple[tuple[sp.Expr, ...], ...]
    motors: tuple[MotorSpec, ...]

    @cached_property
    def joint_from_motor(self) -> sp.ImmutableMatrix:
        """The matrix S (n, n) from motor speeds to joint speeds, ``dq = S dq_m``."""
        gears = sp.diag(*(1 / motor.gear_ratio for motor in self.motors))
        return sp.ImmutableMatrix(sp.Matrix(self.joint_from_drive) * gears)

    @cached_property
    def motor_from_joint(self) -> sp.ImmutableMatrix:
        """The matrix (n, n) from joint speeds to motor speeds, the inverse of :attr:`joint_from_motor`.

        Row k is the direction ``w`` (n,) of motor k: its speed is ``w dq``, and its torque tau_m adds ``w' tau_m`` at
        the joints.
        """
        return sp.ImmutableMatrix(self.joint_from_motor.inv(method="LU"))


@dataclass(frozen=True)
class JointSpec:
    """One row of the Denavit-Hartenberg table, with what belongs to the joint.

    ``name`` and ``type`` of the joint; ``alpha`` and ``theta`` in rad, ``a`` and ``d`` in m, exact expressions.
    ``theta`` is the offset added to q of a revolute joint, ``d`` the offset added to q of a prismatic joint.
    ``limits``, ``friction`` and ``drive`` as the file states them; None for friction or drive that it does not state.
    ``sign`` is -1 where q moves against the axis of the row, whose frames stay as they are; rows of a mechanism have 1,
    since its matrix holds their signs. ``gamma`` (rad) and ``b`` (m), of modified rows only, place a branch on the link
    that carries it: the row is ``Rz(gamma) Tz(b) Rx(alpha) Tx(a) Rz(theta) Tz(d)`` (Khalil and Kleinfinger 1986).
    """

    name: str
    type: JointType
    alpha: sp.Expr
    a: sp.Expr
    d: sp.Expr
    theta: sp.Expr
    limits: Limits = field(default_factory=Limits)
    friction: FrictionSpec | None = None
    drive: DriveSpec | None = None
    sign: int = 1
    gamma: sp.Expr = sp.S.Zero
    b: sp.Expr = sp.S.Zero

    @property
    def is_revolute(self) -> bool:
        """Whether q of this joint is an angle."""
        return self.type == "revolute"


@dataclass(frozen=True)
class LoopSpec:
    """A closed loop of rows: a pin, with its axis across the plane of the loop, joins two links that a tree does not.

    ``passive`` are the two rows without drive whose displacements the pin determines, in the order of the table.
    ``pins`` are two links, each by its row (-1: the base), and the place of the pin in the axes of its link frame (3,),
    m. ``assembly`` is +1 or -1: which of the two ways to assemble the loop. With a ``start`` the loop is solved by
    Newton's method instead of in closed form: the displacements of both passive rows, rad or m, near which it is
    assembled where the drives stand at the positions next to zero within their limits; ``assembly`` then is 0.
    """

    name: str
    passive: tuple[int, int]
    pins: tuple[tuple[int, tuple[sp.Expr, sp.Expr, sp.Expr]], tuple[int, tuple[sp.Expr, sp.Expr, sp.Expr]]]
    assembly: int
    start: tuple[sp.Expr, sp.Expr] | None = None


@dataclass(frozen=True)
class MechanismSpec:
    """The rows of a robot in which joints follow others, or which branches, also with closed loops.

    Row i is displaced by ``y_i = matrix[i] . x``, with x the positions q of the driven joints and, behind them, the
    displacements of the rows :attr:`passive` of ``loops``; it is carried by the link of row ``parents[i]`` (-1: by the
    base). Limits and drives of driven joints are in ``RobotSpec.joints``; a row that follows others has position limits
    only, a passive one none. The tool is fixed to the link of row ``tip``. ``matrix`` (rows, joints + passive rows) is
    exact; the constant of a coupling is part of the row's theta or d.
    """

    rows: tuple[JointSpec, ...]
    parents: tuple[int, ...]
    tip: int
    matrix: tuple[tuple[sp.Expr, ...], ...]
    loops: tuple[LoopSpec, ...] = ()

    @property
    def passive(self) -> tuple[int, ...]:
        """The rows whose displacements closed loops determine, two of every loop, in the order of the loops."""
        return tuple(row for loop in self.loops for row in loop.passive)

    def path(self, row: int) -> tuple[int, ...]:
        """The rows from the base to ``row``."""
        rows = [row]
        while self.parents[rows[-1]] >= 0:
            rows.append(self.parents[rows[-1]])
        return tuple(reversed(rows))


def joint_units(joint: JointSpec) -> dict[str, str]:
    """The SI units of the position and of the torque or force of a joint."""
    return {"unit": "rad", "torque_unit": "N m"} if joint.is_revolute else {"unit": "m", "torque_unit": "N"}


@dataclass(frozen=True)
class LinkSpec:
    """Inertia of one link in the axes of its link frame.

    ``mass`` in kg; ``com`` (3,), the centre of mass in the link frame, m. ``inertia`` is the inertia *tensor* in kg m^2
    (off-diagonals ``xy = -integral of x*y dm``) about ``about``: the centre of mass or the origin of the link frame, in
    the order xx, yy, zz, xy, xz, yz. ``products`` is how the file wrote the off-diagonals, kept to print them back.
    """

    mass: sp.Rational
    com: tuple[sp.Rational, sp.Rational, sp.Rational]
    inertia: tuple[sp.Rational, ...]
    about: Literal["com", "origin"]
    products: Literal["tensor", "positive"] = "tensor"

    def inertia_about_origin(self) -> tuple[sp.Rational, ...]:
        """The tensor about the origin of the link frame (xx, yy, zz, xy, xz, yz): Steiner's theorem."""
        if self.about == "origin":
            return self.inertia
        m, (x, y, z) = self.mass, self.com
        shift = (y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z)
        return tuple(entry + m * moved for entry, moved in zip(self.inertia, shift, strict=True))


@dataclass(frozen=True)
class FixedTransform:
    """A fixed homogeneous transform ``T = [[R, p], [0, 1]]`` with exact entries.

    ``rotation`` is R in row-major order (9), ``translation`` is p (3) in m.
    """

    rotation: tuple[sp.Expr, ...] = tuple(sp.Integer(int(i % 4 == 0)) for i in range(9))
    translation: tuple[sp.Expr, ...] = (sp.S.Zero, sp.S.Zero, sp.S.Zero)

    def matrix(self) -> sp.Matrix:
        """The homogeneous matrix T (4, 4)."""
        R = sp.Matrix(3, 3, list(self.rotation))
        return R.row_join(sp.Matrix(self.translation)).col_join(sp.Matrix([[0, 0, 0, 1]]))

    def append_screw(self, angle: sp.Expr, length: sp.Expr) -> FixedTransform:
        """The transform ``T Rz(angle) Tz(length)``, angle in rad and length in m."""
        c, s = sp.cos(angle), sp.sin(angle)
        turn = sp.Matrix([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, length], [0, 0, 0, 1]])
        T = self.matrix() * turn
        return FixedTransform(tuple(T[:3, :3]), (T[0, 3], T[1, 3], T[2, 3]))


@dataclass(frozen=True)
class TipSpec:
    """A named tip of a robot that branches: ``tool``, fixed to the link of the row called ``row``."""

    row: str
    tool: FixedTransform = field(default_factory=FixedTransform)


@dataclass(frozen=True)
class BasisSpec:
    """Base parameters chosen by the user: their ``names`` and ``expressions`` in link symbols.

    Link symbols (link i, counted from 1, in the axes of link frame i): ``m{i}``; COM ``x{i} y{i} z{i}``; first moments
    ``mx{i} my{i} mz{i}``; inertia about the *origin* of the link frame ``Ixx{i} Iyy{i} Izz{i} Ixy{i} Ixz{i} Iyz{i}``,
    the off-diagonals being tensor entries (``products="tensor"``) or positive products (``"positive"``).
    Named parameters of the file may occur too. All are real symbols, made by :func:`parameter_symbol`. ``places`` are
    line and column of each entry in the file, for messages.
    """

    names: tuple[str, ...]
    expressions: tuple[sp.Expr, ...]
    products: Literal["tensor", "positive"]
    places: tuple[tuple[int, int], ...] = field(default=(), compare=False)


@dataclass(frozen=True)
class FitSpec:
    """A fingerprint of recorded samples that the parameters were fitted to.

    ``hashes`` are the smallest hashes of ``windows`` windows of samples, in rising order, as computed by
    :mod:`rrrgen.lab.identify.scores`; ``program``, ``recordings`` and ``data`` are informative texts.
    """

    hashes: tuple[int, ...]
    windows: int
    program: str = ""
    recordings: str = ""
    data: str = ""


@dataclass(frozen=True)
class RobotSpec:
    """One robot as its file describes it, validated: the result of :func:`rrrgen.load_spec`.

    - ``name``, ``description``, and ``source`` (where the numbers come from);
    - ``convention``: "standard" or "modified" Denavit-Hartenberg rows;
    - ``gravity``: acceleration of gravity, m/s^2, in the base frame, which is the one before ``base`` and the one in
      which the pose of the tip is given;
    - ``parameters``: nominal values of named parameters, exact; ``parameter_units``: the unit that each was declared
      in, "one" for a plain number, no entry for a bare SI value;
    - ``joints`` and ``links``, one for each joint; ``links`` is None if the file states no inertias;
    - ``base`` and ``tool``: fixed transforms before the first joint and after the last link frame; ``tools``: others
      that may take the place of ``tool``, by name; ``tips``: others that may take the place of the tip, by name;
    - ``mechanism``: the rows of the table, if some of them follow other joints or branch off; ``joints`` are then only
      the driven joints, whose positions are q, and there is a link for every row. None for a serial chain of driven
      joints;
    - ``floating_base``: whether the base moves freely; its body is the first, fixed row, and gravity is in world axes;
    - ``basis``: base parameters chosen by the user, or None; ``drives``: coupled drives, None if every joint has its
      own;
    - ``angle_unit`` and ``length_unit``: those that the file was written in, to print it back;
    - ``provenance``: what the parameters were fitted to, which changes nothing about the robot;
    - ``emit``: what is emitted besides the model, which changes nothing either; ``gravity_input``: whether every
      function that depends on gravity takes it as an input (:meth:`in_any_gravity`);
    - ``ik``: "general", or "nominal_first" where the inverse kinematics of a nearly special arm starts from the special
      one;
    - ``file``: path or bundled name, and ``faults``: warnings; for messages only.
    """

    name: str
    convention: Convention
    gravity: tuple[sp.Expr, sp.Expr, sp.Expr]
    parameters: dict[str, sp.Expr]
    joints: tuple[JointSpec, ...]
    links: tuple[LinkSpec, ...] | None = None
    base: FixedTransform = field(default_factory=FixedTransform)
    tool: FixedTransform = field(default_factory=FixedTransform)
    tools: dict[str, FixedTransform] = field(default_factory=dict)
    tips: dict[str, TipSpec] = field(default_factory=dict)
    basis: BasisSpec | None = None
    drives: DrivesSpec | None = None
    angle_unit: str = "rad"
    length_unit: str = "m"
    description: str = ""
    source: str = ""
    file: str = field(default="", compare=False)
    faults: tuple[Fault, ...] = field(default=(), compare=False)
    parameter_units: dict[str, str] = field(default_factory=dict)
    provenance: tuple[FitSpec, ...] = ()
    emit: tuple[str, ...] = ()
    gravity_input: bool = False
    ik: str = "general"
    mechanism: MechanismSpec | None = None
    floating_base: bool = False

    @property
    def n(self) -> int:
        """Number of joints, the length of q."""
        return len(self.joints)

    @property
    def rows(self) -> tuple[JointSpec, ...]:
        """The rows of the table: the joints, or those of the mechanism, which include followers and branches."""
        return self.joints if self.mechanism is None else self.mechanism.rows

    @property
    def parents(self) -> tuple[int, ...]:
        """For every row, the row whose link carries it; -1 for the base."""
        return tuple(range(-1, len(self.joints) - 1)) if self.mechanism is None else self.mechanism.parents

    @property
    def loops(self) -> tuple[LoopSpec, ...]:
        """The closed loops of the mechanism."""
        return () if self.mechanism is None else self.mechanism.loops

    @property
    def newton(self) -> bool:
        """Whether the closed loops are solved by Newton's method, all together."""
        return any(loop.start is not None for loop in self.loops)

    @property
    def tip_row(self) -> int:
        """The row whose link carries the tool."""
        return len(self.joints) - 1 if self.mechanism is None else self.mechanism.tip

    def at_tip(self, name: str) -> RobotSpec:
        """The same robot with the tip of this ``name`` as its only one."""
        chosen = self.tips[name]
        row = next(i for i, joint in enumerate(self.rows) if joint.name == chosen.row)
        if self.mechanism is None:
            raise InternalError("a robot with named tips has a mechanism")
        return replace(self, tool=chosen.tool, tips={}, mechanism=replace(self.mechanism, tip=row))

    def in_any_gravity(self) -> RobotSpec:
        """The same robot with gravity as an input of its functions, under the name ``<name>_any_gravity``.

        It has more base parameters, so that those chosen in the robot file would be no basis.
        """
        return replace(self, name=f"{self.name}_any_gravity", gravity_input=True, basis=None)

    def nominal(self, expression: sp.Expr) -> sp.Expr:
        """Replace every named parameter in ``expression`` by its nominal value; the result is exact."""
        if not expression.free_symbols:
            return expression
        return expression.xreplace({parameter_symbol(k): v for k, v in self.parameters.items()})

    @property
    def has_placements(self) -> bool:
        """Whether a row of the table is placed on its carrier by gamma or b."""
        return any(row.gamma != 0 or row.b != 0 for row in self.rows)

    def placements(self) -> list[tuple[float, float]]:
        """``(gamma, b)`` of every row at the nominal values, rad and m, as floats; zero but for branches."""
        return [(float(self.nominal(row.gamma)), float(self.nominal(row.b))) for row in self.rows]

    def dh_table(self) -> list[tuple[str, float, float, float, float]]:
        """Rows ``(type, alpha, a, d, theta)`` at the nominal values, SI and rad, as floats; without gamma and b."""
        rows: list[tuple[str, float, float, float, float]] = []
        for joint in self.rows:
            values = [float(self.nominal(v)) for v in (joint.alpha, joint.a, joint.d, joint.theta)]
            rows.append((joint.type, values[0], values[1], values[2], values[3]))
        return rows


# ------------------------------------------------------------------------------------------------------------------
# The ten standard inertial parameters of a link: their order, and conversion from and to the links of a robot file.
#
# ``phi = (m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz)``: mass (kg), first moments (kg m) and inertia tensor (kg m^2,
# ``Ixy = -integral of x y dm``) about the origin of the link frame, in its axes. The order is stated only here; the
# references of :mod:`rrrgen.verify` repeat it on purpose, because they share no code with the compiler.
# ------------------------------------------------------------------------------------------------------------------

STANDARD = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Names of the standard parameters of one link, in their order."""


def standard_names(n: int) -> tuple[str, ...]:
    """Names of the 10 n standard parameters of n links: ``m1, mx1, ..., Izz1, m2, ...``."""
    return tuple(f"{name}{link + 1}" for link in range(n) for name in STANDARD)


def standard_parameters(link: LinkSpec) -> tuple[sp.Rational, ...]:
    """The exact standard parameters (10,) of a link, in the order of :data:`STANDARD`."""
    Ixx, Iyy, Izz, Ixy, Ixz, Iyz = link.inertia_about_origin()
    mx, my, mz = (link.mass * c for c in link.com)
    return (link.mass, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz)


def link_of(phi: Iterable[float]) -> LinkSpec:
    """Make the link with the standard parameters ``phi`` (10,), mass > 0; doubles are converted to exact decimals."""
    exact = [sp.Rational(repr(float(value))) for value in phi]
    m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz = exact
    com = tuple(sp.Rational(repr(float(first) / float(m))) for first in (mx, my, mz))
    return LinkSpec(m, (com[0], com[1], com[2]), (Ixx, Iyy, Izz, Ixy, Ixz, Iyz), about="origin", products="tensor")
