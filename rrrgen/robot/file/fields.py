"""The keys of a robot file, one table per section."""

from __future__ import annotations

from rrrgen.base.yamltext.fields import Format, Key
from rrrgen.robot.friction.laws import LAWS

MAX_JOINTS = 64
BASE = "base"  # what ``parent`` names in place of a joint
MAX_FITS = 50
HASH_DIGITS = 12  # hexadecimal, of one hash of recorded samples

LANGUAGES = {
    "cpp": "a header for C++17 with std::array, Eigen maps on request",
    "javascript": "a module for browsers and Node, without dependencies",
    "rust": "a crate without std; inverse kinematics is in the C alone",
}
"""Languages in which the model can be printed besides C and CasADi: for every word a module of that name in the room
``backends``, with the constant ``BACKEND``, and what it prints."""

EMIT = dict(
    sorted(
        {
            "control": "control laws: PD with gravity, computed torque, adaptive, ..",
            "controller": "the controller as one unit: modes, observer, faults",
            "elastic": "dynamics and control laws with elastic joints",
            "gravity": "the model with gravity as an input: <name>_any_gravity.h",
            "hessian": "Hessians of inverse and forward dynamics, dM/dq",
            "observer": "momentum observer of external torques, contact, wrench",
            "points": "Jacobians and wrenches at any point, tools, null space",
            "tensors": "all second derivatives of the torques, up to 8 joints",
            "timing": "time-optimal timing of a path within limits",
            "trajectory": "quintic and trapezoidal motions",
            **LANGUAGES,
        }.items()
    )
)
"""Languages, files and groups of functions that can be emitted besides the model, on request of the robot file or the
command line, each with its description."""

IK = ("general", "nominal_first")
"""How an arm near a special geometry is solved: by general equations, or by those of the special arm and refinement."""

ROBOT = (
    Key("schema", "choice", "version of this format", True, ("rrrgen/1",)),
    Key("name", "name", "C identifier; prefix of every emitted symbol", True),
    Key("description", "text", "what the robot is"),
    Key("source", "text", "where the numbers come from"),
    Key("convention", "choice", "Denavit-Hartenberg convention", True, ("standard", "modified")),
    Key("units", "mapping", "units of bare angles and lengths", True, section="units"),
    Key("gravity", "vector", "acceleration of gravity in the base frame, m/s^2", True, quantity="acceleration"),
    Key("parameters", "names", "named constants with nominal values"),
    Key("base", "mapping", "fixed transform before the first joint", section="transform"),
    Key(
        "floating_base", "mapping", "body of a base that moves freely; `parent: base` stands on it", section="floating"
    ),
    Key("joints", "rows", "one Denavit-Hartenberg row per joint", True, section="joint", length=MAX_JOINTS),
    Key("tip", "name", "joint whose link carries the tool; needed where the joints branch"),
    Key("loops", "transforms", "closed loops by name, each of two passive joints and a pin", section="loop"),
    Key("tool", "mapping", "fixed transform after the last link frame", section="transform"),
    Key("tools", "transforms", "other tools by name; `robot.yaml@name` has that tool", section="transform"),
    Key(
        "tips",
        "transforms",
        "tips of a branching robot by name, each with functions of its own, `<robot>_<name>_jacobian`",
        section="tip",
    ),
    Key("links", "rows", "inertia of every link, in the axes of its link frame", section="link", length=MAX_JOINTS),
    Key("drives", "mapping", "drives that move several joints each, as in a coupled wrist", section="drives"),
    Key("basis", "basis", "base parameters of the user's own choice"),
    Key("emit", "choices", "what `rrrgen generate` also writes for this robot", choices=tuple(EMIT)),
    Key(
        "ik",
        "choice",
        "inverse kinematics of a calibrated arm: general (if missing), or faster from the nominal arm",
        choices=IK,
    ),
    Key("provenance", "rows", "recorded samples the parameters were fitted to", section="fit", length=MAX_FITS),
)
FIT = (
    Key("program", "text", "what fitted them"),
    Key("recordings", "text", "names of the recordings"),
    Key("data", "text", "which part of the recordings was fitted"),
    Key("method", "choice", "how the samples were hashed", True, ("rrrgen-samples/1",)),
    Key("windows", "count", "how many windows of samples were hashed", True),
    Key("fingerprint", "texts", "the smallest hashes in rising order, hexadecimal, several to a line", True),
)
UNITS = (
    Key("angle", "choice", "unit of bare angles", True, ("rad", "deg")),
    Key("length", "choice", "unit of bare lengths", True, ("m", "mm")),
)
JOINT = (
    Key("name", "name", "name of the joint; q1, q2, ... if missing"),
    Key("type", "choice", "revolute or prismatic", True, ("revolute", "prismatic")),
    Key("alpha", "value", "twist angle", True, quantity="angle", file_units=True),
    Key("a", "value", "link length", True, quantity="length", file_units=True),
    Key("d", "value", "link offset; of a prismatic joint: added to q", quantity="length", file_units=True),
    Key("theta", "value", "joint angle; of a revolute joint: added to q", quantity="angle", file_units=True),
    Key("gamma", "value", "modified rows: turn of this row about z of its carrier", quantity="angle", file_units=True),
    Key("b", "value", "modified rows: shift of this row along z of its carrier", quantity="length", file_units=True),
    Key("sign", "choice", "-1: q moves against the axis of the row; its frames stay", choices=("1", "+1", "-1")),
    Key("parent", "name", "joint whose link carries this one, or base; the joint before it if missing"),
    Key(
        "follows",
        "names",
        "the joint moves by a sum of multiples of others, {elbow: -1}; its own name: its own drive; {}: a fixed row",
    ),
    Key("limits", "mapping", "joint limits", section="limits"),
    Key("friction", "mapping", "friction at the joint; each key adds its column", section="friction"),
    Key("drive", "mapping", "the drive, seen at the joint", section="drive"),
)
LIMITS = (
    Key("lower", "value", "lowest q", quantity="joint angle", prismatic="length", file_units=True),
    Key("upper", "value", "highest q", quantity="joint angle", prismatic="length", file_units=True),
    Key("velocity", "value", "largest |dq|", quantity="angular speed", prismatic="speed", file_units=True),
    Key(
        "acceleration",
        "value",
        "largest |ddq|",
        quantity="angular acceleration",
        prismatic="acceleration",
        file_units=True,
    ),
    Key("torque", "value", "largest torque or force", quantity="torque", prismatic="force"),
)
_QUANTITIES = {
    "N m s/rad": ("angular damping", "damping"),
    "N m": ("torque", "force"),
    "rad/s": ("angular speed", "speed"),
    "rad": ("angle", "length"),
}
"""Physical quantities of a friction parameter, (for a revolute, for a prismatic joint), by its unit at a revolute
joint; parameters with other units are numbers in SI without a unit."""


def _law_keys() -> tuple[Key, ...]:
    """The keys of all parameters of friction laws; a parameter that several laws share has one key."""
    keys = {}
    for law in LAWS.values():
        for parameter in law.parameters:
            quantity, prismatic = _QUANTITIES.get(parameter.unit, ("number", ""))
            bare = quantity == "number" and parameter.unit != "-"
            meaning = f"{parameter.meaning}, {parameter.unit}" if bare else parameter.meaning
            keys[parameter.name] = Key(parameter.name, "value", meaning, quantity=quantity, prismatic=prismatic)
    return tuple(keys.values())


LINEAR_FRICTION = (
    Key("viscous", "value", "torque or force per speed", quantity="angular damping", prismatic="damping"),
    Key("coulomb", "value", "torque or force of dry friction", quantity="torque", prismatic="force"),
    Key("offset", "value", "constant torque or force", quantity="torque", prismatic="force"),
)
FRICTION = (
    *LINEAR_FRICTION,
    Key("law", "choice", "friction law; coulomb_viscous if missing", choices=tuple(LAWS)),
    *(key for key in _law_keys() if key.name not in ("viscous", "coulomb", "offset")),
)
DRIVE = (
    Key("inertia", "value", "rotor inertia seen at the joint, Ia", quantity="inertia", prismatic="mass"),
    Key("gear_ratio", "value", "motor turns per joint turn"),
    Key(
        "torque_constant",
        "value",
        "joint torque or force per ampere",
        quantity="torque constant",
        prismatic="force constant",
    ),
    Key(
        "encoder_resolution",
        "value",
        "smallest step of q",
        quantity="angle",
        prismatic="length",
        file_units=True,
    ),
    Key(
        "stiffness",
        "value",
        "stiffness of an elastic joint, between rotor and link",
        quantity="angular stiffness",
        prismatic="stiffness",
    ),
    Key("damping", "value", "damping beside that stiffness", quantity="angular damping", prismatic="damping"),
)
DRIVES = (
    Key("joint_from_drive", "square", "joint speeds = matrix * drive speeds; a row per joint, a column per drive"),
    Key("drive_from_joint", "square", "drive speeds = matrix * joint speeds, in place of joint_from_drive"),
    Key("motors", "rows", "one motor per drive, in the order of the matrix", True, section="motor", length=MAX_JOINTS),
)
MOTOR = (
    Key("name", "name", "name of the motor; m1, m2, ... if missing"),
    Key("type", "choice", "revolute (if missing), or prismatic for a linear motor", choices=("revolute", "prismatic")),
    Key("gear_ratio", "value", "motor turns per turn of the drive; 1 if missing"),
    Key("inertia", "value", "rotor inertia at the motor shaft", quantity="inertia", prismatic="mass"),
    Key("friction", "mapping", "friction at the motor shaft; each key adds its column", section="friction"),
    Key("torque_limit", "value", "largest torque or force of the motor", quantity="torque", prismatic="force"),
)
LINK = (
    Key("mass", "value", "mass, kg", True, quantity="mass"),
    Key("com", "vector", "centre of mass in the link frame", True, quantity="length", file_units=True),
    Key("inertia", "mapping", "inertia in the axes of the link frame, kg m^2", True, section="inertia"),
)
INERTIA = (
    Key("about", "choice", "reference point: centre of mass or origin of the link frame", True, ("com", "origin")),
    Key(
        "products",
        "choice",
        "sign of xy, xz, yz: tensor entries -int xy dm, or positive",
        False,
        ("tensor", "positive"),
    ),
    *(Key(f"{a}{a}", "value", f"moment about {a}, kg m^2", True, quantity="inertia") for a in "xyz"),
    *(Key(ab, "value", f"product of inertia {ab}, kg m^2", quantity="inertia") for ab in ("xy", "xz", "yz")),
)
TRANSFORM = (
    Key("translation", "vector", "origin of the new frame", quantity="length", file_units=True),
    Key("rpy", "vector", "roll, pitch, yaw about the fixed axes x, y, z", quantity="angle", file_units=True),
    Key("rotation", "matrix", "rotation matrix, row by row"),
)
FLOATING = (
    Key("name", "name", "name of the body", True),
    Key("mass", "value", "mass, kg", True, quantity="mass"),
    Key("com", "vector", "centre of mass in the frame of the base", True, quantity="length", file_units=True),
    Key("inertia", "mapping", "inertia in the axes of the base, kg m^2", True, section="inertia"),
)
TIP = (
    Key("row", "name", "joint whose link carries this tip", True),
    Key("tool", "mapping", "fixed transform from its link frame to the tip", section="transform"),
)
LOOP = (
    Key("passive", "pair", "the two joints without drive that the loop moves", True),
    Key(
        "pins",
        "points",
        "the two links that a pin joins, or base, each with its place in that link frame",
        True,
        quantity="length",
        file_units=True,
    ),
    Key(
        "assembly",
        "choice",
        "+1: the pin between the passive links lies left of the line from the outer pin of the first to that of the "
        "second, -1: right, seen against the axis of the first; with a prismatic joint, +1: the larger of the two "
        "displacements at which the loop closes, -1: the smaller; not beside `solve`",
        False,
        ("1", "+1", "-1"),
    ),
    Key("solve", "choice", "how a loop is solved that is no dyad; then for all loops", False, ("newton",)),
    Key(
        "start",
        "displacements",
        "displacements of the passive joints near which a loop with `solve` is assembled where the drives stand at "
        "zero, or at the limit next to it",
        quantity="joint angle",
        prismatic="length",
        file_units=True,
    ),
)
BASIS = (
    Key("products", "choice", "sign of Ixy, Ixz, Iyz in the expressions", True, ("tensor", "positive")),
    Key("parameters", "basis", "the expressions", True),
)

SECTIONS: dict[str, tuple[Key, ...]] = {
    "robot": ROBOT,
    "units": UNITS,
    "joint": JOINT,
    "limits": LIMITS,
    "friction": FRICTION,
    "drive": DRIVE,
    "drives": DRIVES,
    "motor": MOTOR,
    "link": LINK,
    "inertia": INERTIA,
    "transform": TRANSFORM,
    "floating": FLOATING,
    "tip": TIP,
    "loop": LOOP,
    "basis": BASIS,
    "fit": FIT,
}

# words that users bring along from other formats
ALIASES: dict[str, str] = {
    "offset": "theta",
    "twist": "alpha",
    "angle": "theta",
    "q": "theta",
    "r": "a",
    "length": "a",
    "joint_type": "type",
    "dh": "joints",
    "bodies": "links",
    "inertial": "links",
    "convention_dh": "convention",
    "effort": "torque",
    "gear": "gear_ratio",
    "coupling": "joint_from_drive",
    "matrix": "joint_from_drive",
    "transmission": "drives",
    "coupled_drives": "drives",
    "rotor_inertia": "inertia",
    "max_torque": "torque_limit",
    "max_velocity": "velocity",
    "max_acceleration": "acceleration",
    "min": "lower",
    "max": "upper",
    "m": "mass",
    "cog": "com",
    "ixx": "xx",
    "iyy": "yy",
    "izz": "zz",
    "ixy": "xy",
    "ixz": "xz",
    "iyz": "yz",
    "xyz": "translation",
    "origin": "translation",
    "rotation_matrix": "rotation",
}

ROBOT_FILE = Format(SECTIONS, ALIASES)
