"""MJCF, the XML of MuJoCo: the serial chain from a chosen body to a chosen body or site becomes a robot file.

The pose of a body is ``pos`` and ``quat`` (or another rotation) in its parent; its joints, in their order, rotate about
or shift along axes that are given in the frame of the body. Angles are in degrees unless the element ``compiler`` says
otherwise. A body without ``inertial`` has the inertia of its geoms; that of meshes cannot be computed here, which a
warning says.
"""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np

from rrrgen.base.yamltext.document import FaultList
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.robot.importers.interface import Found, Importer, Source
from rrrgen.robot.importers.trees.bodies import (
    SIZES,
    Body,
    Constraint,
    Inertia,
    Mimic,
    Shaft,
    Tree,
    TreeJoint,
    inertia,
    vector_rows,
    volume,
)
from rrrgen.robot.importers.trees.denavit_hartenberg import robot_of_tree
from rrrgen.robot.importers.trees.exact_numbers import (
    EQUAL,
    HIGH,
    Array,
    cross,
    identity,
    norm,
    number,
    rotation,
    transform,
    vector,
    without_noise,
)
from rrrgen.robot.importers.trees.serial_chain import MAX_NAMED, motion
from rrrgen.robot.importers.trees.xml import Element, Values, parse_xml, refuse_repeated, refuse_unknown, xml_text
from rrrgen.robot.spec import DriveSpec, FrictionSpec, Limits

# ------------------------------------------------------------------------------------------------------------------
# Settings of an MJCF that apply to many elements: units, Euler sequence, gravity, classes of defaults; poses.
# ------------------------------------------------------------------------------------------------------------------

ROTATIONS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")
DEGREE = HIGH.pi / 180
ACTUATORS = ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion")
"""Elements that share one record of defaults, that of ``general``."""


class Settings:
    """Settings of a MuJoCo model (MJCF), read from its elements ``compiler``, ``option`` and ``default``."""

    def __init__(self, root: Element, values: Values) -> None:
        compilers = root.all("compiler")
        stated = {key: value for compiler in compilers for key, value in compiler.attributes.items()}
        self.angle: Any = number(1) if stated.get("angle") == "radian" else DEGREE
        self.sequence = stated.get("eulerseq", "xyz")
        self.auto_limits = stated.get("autolimits", "true") == "true"
        self.from_geoms = stated.get("inertiafromgeom", "auto")
        self.massive_groups = [number(0), number(5)]
        self.gravity = vector((0, 0, "-9.81"))
        for compiler in compilers:
            self._check(compiler, values)
            if "inertiagrouprange" in compiler.attributes:
                self.massive_groups = values.numbers(compiler, "inertiagrouprange", 2) or self.massive_groups
        for option in root.all("option"):
            if "gravity" in option.attributes:
                self.gravity = vector(values.three(option, "gravity"))
        self.disabled = _read_disabled(root)
        if "gravity" in self.disabled:
            self.gravity = vector((0, 0, 0))
        self.defaults: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for default in root.all("default"):
            self._read_class(default, None)
        for element in (descendant for part in root.children if part.tag != "default" for descendant in part.walk()):
            for key in ("class", "childclass"):
                name = element.attributes.get(key, "main")
                if name not in self.defaults:
                    hint = did_you_mean(name, self.defaults) or "classes stand in <default class=...>"
                    values.faults.error(element.place_of(key), f"there is no default class '{name}'", hint)

    def _check(self, compiler: Element, values: Values) -> None:
        if sorted(self.sequence.lower()) != ["x", "y", "z"] and not set(self.sequence) <= set("xyzXYZ"):
            values.faults.error(compiler.place_of("eulerseq"), f"eulerseq is '{self.sequence}'", "such as xyz or ZYX")
        for name in ("coordinate", "settotalmass", "balanceinertia", "boundmass", "boundinertia"):
            value = compiler.attributes.get(name, "")
            if value not in ("", "local", "false", "0", "-1"):
                hint = "MuJoCo would change the bodies; write a file in which it is not set"
                values.faults.error(compiler.place_of(name), f"{name} is '{value}'", hint)

    def _read_class(self, element: Element, parent: str | None) -> None:
        """Record the default attributes of a class, by tag of the element, including those of the class around it."""
        name = element.attributes.get("class", "main")
        known = {tag: dict(entries) for tag, entries in self.defaults.get(parent or "main", {}).items()}
        for child in element.children:
            if child.tag != "default":
                tag = "general" if child.tag in ACTUATORS else child.tag
                known.setdefault(tag, {}).update(child.attributes)
        self.defaults[name] = known
        for child in element.all("default"):
            self._read_class(child, name)

    def is_limited(self, element: Element, what: str) -> bool:
        """Whether a range that ``element`` states holds; ``what`` is the beginning of the attribute that says so."""
        limited = element.attributes.get(f"{what}limited", "auto")
        return limited == "true" or (limited == "auto" and self.auto_limits)

    def with_defaults(self, element: Element, inherited: str, tag: str = "") -> Element:
        """Complete ``element`` by the defaults of its class, or of the class ``inherited`` from bodies around it.

        They are those for elements with the same tag, or with ``tag`` where defaults have one tag for several.
        """
        chosen = self.defaults.get(element.attributes.get("class", inherited), {}).get(tag or element.tag, {})
        return Element(
            element.tag, {**chosen, **element.attributes}, element.place, element.children, places=element.places
        )


def _read_disabled(root: Element) -> set[str]:
    """The parts of the physics that the last flag of the file about them disables."""
    flags = [flag for option in root.all("option") for flag in option.all("flag")]
    last = {key: value for flag in flags for key, value in flag.attributes.items()}
    return {key for key, value in last.items() if value == "disable"}


def pose(element: Element, settings: Settings, values: Values) -> Array:
    """The pose (4, 4) that an element states in the one around it."""
    return transform(_rotation(element, settings, values), [without_noise(x) for x in values.three(element, "pos")])


def _rotation(element: Element, settings: Settings, values: Values) -> Array:
    given = [name for name in ROTATIONS if name in element.attributes]
    if len(given) > 1:
        values.faults.error(element.place_of(given[1]), f"{given[0]} and {given[1]} are both given", "one rotation")
    if not given:
        return identity(3)
    name = given[0]
    numbers = values.numbers(element, name, {"quat": 4, "axisangle": 4, "xyaxes": 6}.get(name, 3))
    if numbers is None:
        return identity(3)
    if name == "euler":
        return _euler([values.angle(angle * settings.angle) for angle in numbers], settings.sequence)
    if name == "quat":
        return _of_quaternion(element, numbers, values)
    if name == "axisangle":
        return rotation(values.direction(element, name, numbers[:3]), values.angle(numbers[3] * settings.angle))
    if name == "zaxis":
        return to_axis(values.direction(element, name, numbers))
    x = values.direction(element, name, numbers[:3])
    y = vector(numbers[3:])
    y = values.direction(element, name, list(y - sum(x * y) * x))
    return np.asarray(np.array([x, y, cross(x, y)], dtype=object).T)


def _euler(angles: list[Any], sequence: str) -> Array:
    """The rotation (3, 3) of three Euler ``angles`` (rad) about the axes named in ``sequence``.

    Lower-case letters are axes of the moving frame, upper-case ones fixed axes.
    """
    R = identity(3)
    for letter, angle in zip(sequence, angles, strict=False):
        turn = rotation([int(letter.lower() == axis) for axis in "xyz"], angle)
        R = R @ turn if letter.islower() else turn @ R
    return R


def _of_quaternion(element: Element, numbers: list[Any], values: Values) -> Array:
    """The rotation (3, 3) of a quaternion (w, x, y, z), which is normalized first.

    Angle and axis are exact where they are close to a multiple of 15 degrees and to a principal axis.
    """
    v = vector(numbers[1:])
    length = norm(v)
    if length <= EQUAL:
        return identity(3)
    angle = values.angle(2 * HIGH.atan2(length, numbers[0]))
    return rotation(values.direction(element, "quat", list(v)), angle)


def to_axis(z: Array) -> Array:
    """The smallest rotation (3, 3) that turns the z axis to the unit vector ``z``."""
    axis = cross(vector((0, 0, 1)), z)
    sine = norm(axis)
    if sine <= EQUAL:
        return identity(3) if z[2] > 0 else rotation((1, 0, 0), HIGH.pi)
    return rotation(axis / sine, HIGH.atan2(sine, z[2]))


# ------------------------------------------------------------------------------------------------------------------
# Actuators and fixed tendons of an MJCF: torque limits of joints, and motors that move several joints.
# ------------------------------------------------------------------------------------------------------------------


def friction_of(element: Element, settings: Settings, values: Values) -> FrictionSpec | None:
    """Viscous and Coulomb friction of a joint or a tendon; None where it states none, or zero, or has it disabled."""
    viscous, coulomb = _damping(element, settings, values), values.not_negative(element, "frictionloss")
    if settings.disabled & {"frictionloss", "constraint"}:
        coulomb = 0.0
    return FrictionSpec(viscous=viscous or None, coulomb=coulomb or None) if viscous or coulomb else None


def _damping(element: Element, settings: Settings, values: Values) -> float:
    """Viscous friction of a joint, a tendon or an actuator; 0 where it is disabled or ``springdamper`` replaces it."""
    damping = values.numbers(element, "damping", None, "0") or [0]
    if any(x != 0 for x in damping[1:]):
        values.faults.warning(element.place, "damping of higher order is left out", "friction is viscous and Coulomb")
    if damping[0] < 0:
        values.faults.error(
            element.place_of("damping"), f"damping of <{element.tag}> is {float(damping[0]):g}", "0 or more"
        )
    if settings.disabled & {"damper", "passive"} or _has_spring_damper(element, values):
        return 0.0
    return float(damping[0])


def _has_spring_damper(element: Element, values: Values) -> bool:
    """Whether MuJoCo computes stiffness and damping of a joint from a time constant and a damping ratio."""
    return any(x != 0 for x in values.numbers(element, "springdamper", None, "0") or ())


class Actuators:
    """What actuators add to the joints or the tendons that they drive, and the fixed tendons as ``shafts``.

    That is a torque limit, inertia and viscous friction, by names such as ``joint lift``.
    """

    def __init__(self, root: Element, settings: Settings, values: Values, joints: Collection[str]) -> None:
        self.settings, self.values = settings, values
        self.limits: dict[str, float] = {}
        self.inertia: dict[str, float] = defaultdict(float)
        self.viscous: dict[str, float] = defaultdict(float)
        for part in root.all("actuator"):
            for element in part.children:
                self._read_actuator(settings.with_defaults(element, "main", "general"))
        self.limits = {driven: limit for driven, limit in self.limits.items() if 0 < limit < math.inf}
        tendons = [element for part in root.all("tendon") for element in part.children]
        self.shafts = tuple(shaft for element in tendons if (shaft := self._shaft(element, joints)) is not None)

    def complete_joint(self, joint: TreeJoint) -> TreeJoint:
        """Give ``joint`` inertia and friction of its actuators, and their limit unless it has one of its own."""
        driven = f"joint {joint.name}"
        limit = self.limits.get(driven) if joint.limits.torque is None else joint.limits.torque
        inertia = self._total_inertia(driven, joint.drive.inertia if joint.drive is not None else None)
        return replace(
            joint,
            limits=replace(joint.limits, torque=limit),
            friction=self._total_friction(driven, joint.friction),
            drive=DriveSpec(inertia=inertia) if inertia is not None else None,
        )

    def _total_inertia(self, driven: str, stated: float | None) -> float | None:
        return (stated or 0.0) + self.inertia[driven] or None

    def _total_friction(self, driven: str, stated: FrictionSpec | None) -> FrictionSpec | None:
        if not self.viscous[driven]:
            return stated
        friction = stated or FrictionSpec()
        return replace(friction, viscous=(friction.viscous or 0.0) + self.viscous[driven])

    def _read_actuator(self, element: Element) -> None:
        """Add inertia and damping, both ``gear`` squared times, and the largest torque reached in both directions.

        The latter is ``gear`` times the smaller end of ``forcerange``, or of ``ctrlrange`` for a motor, whichever is
        less; it is infinite where neither limits the actuator.
        """
        kind = next((key for key in ("joint", "tendon") if key in element.attributes), None)
        gears = self.values.numbers(element, "gear", None, "1")
        if kind is None or not gears:
            hint = "torque limits are those of joints and coupled drives"
            self.values.faults.warning(element.place, f"the actuator <{element.tag}> is left out", hint)
            return
        torques = []
        for name in ("forcerange", *(("ctrlrange",) if element.tag == "motor" else ())):
            stated = name in element.attributes and self.settings.is_limited(element, name.removesuffix("range"))
            span = self.values.numbers(element, name, 2) if stated else None
            if span and span[0] < 0 < span[1]:
                torques.append(float(min(-span[0], span[1]) * abs(gears[0])))
        driven, square = f"{kind} {element.attributes[kind]}", float(gears[0]) ** 2
        self.inertia[driven] += square * self.values.not_negative(element, "armature")
        self.viscous[driven] += square * _damping(element, self.settings, self.values)
        self.limits[driven] = self.limits.get(driven, 0.0) + min(torques, default=math.inf)

    def _shaft(self, element: Element, joints: Collection[str]) -> Shaft | None:
        name = element.attributes.get("name", "")
        if element.tag != "fixed":
            self.values.faults.warning(element.place, f"the tendon '{name}' is left out", "only fixed tendons are read")
            return None
        weights = {}
        for joint_element in element.all("joint"):
            joint = joint_element.attributes.get("joint", "")
            if joint not in joints:
                self.values.faults.error(joint_element.place_of("joint"), f"there is no joint '{joint}'")
            weights[joint] = self.values.one(joint_element, "coef")
        if any(x != 0 for x in self.values.numbers(element, "stiffness", None, "0") or ()):
            self.values.faults.warning(element.place, f"the spring of tendon '{name}' is left out", "there are none")
        driven = f"tendon {name}"
        inertia = self._total_inertia(driven, self.values.not_negative(element, "armature"))
        friction = self._total_friction(driven, friction_of(element, self.settings, self.values))
        return Shaft(name, weights, inertia, friction, self.limits.get(driven), element.place)


# ------------------------------------------------------------------------------------------------------------------
# Inertia of a body of an MJCF: the one stated in its element ``inertial``, or that of its shapes (geoms).
# ------------------------------------------------------------------------------------------------------------------

WATER = "1000"  # kg/m^3, the density of a geom that states neither density nor mass
MASSLESS = ("plane", "hfield")


def body_inertia(element: Element, inherited: str, settings: Settings, values: Values) -> Inertia | None:
    """The inertia of a body in its frame; None where it has none, or only meshes.

    Geoms of groups outside ``settings.massive_groups`` do not count. Where the file prefers geoms and a body has none
    with a mass, the stated inertia holds.
    """
    stated = element.child("inertial")
    if stated is not None and settings.from_geoms != "true":
        return _read_inertial(stated, settings, values)
    if settings.from_geoms == "false":
        return None
    total: Inertia | None = None
    for geom, frame, place_class in _geoms(element, inherited, identity(), settings, values):
        complete = settings.with_defaults(geom, place_class)
        lowest, highest = settings.massive_groups
        if not lowest <= values.one(complete, "group", "0") <= highest:
            continue
        geom_inertia = _geom(complete, frame, settings, values)
        if geom_inertia is not None:
            total = geom_inertia if total is None else total + geom_inertia
    return _read_inertial(stated, settings, values) if total is None and stated is not None else total


def _geoms(
    element: Element, inherited: str, frame: Array, settings: Settings, values: Values
) -> list[tuple[Element, Array, str]]:
    """All geoms of a body, nested frames included: (geom, pose (4, 4) of its frame in the body, default class)."""
    geoms = [(child, frame, inherited) for child in element.all("geom")]
    for child in element.all("frame"):
        inner = frame @ pose(child, settings, values)
        geoms += _geoms(child, child.attributes.get("childclass", inherited), inner, settings, values)
    return geoms


def _read_inertial(element: Element, settings: Settings, values: Values) -> Inertia:
    mass = values.one(element, "mass")
    if mass < 0:
        values.faults.error(element.place_of("mass"), "the mass is negative")
    if "fullinertia" in element.attributes:
        xx, yy, zz, xy, xz, yz = values.numbers(element, "fullinertia", 6) or [number(0)] * 6
        tensor = vector_rows([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        xx, yy, zz = values.three(element, "diaginertia", "0 0 0")
        tensor = vector_rows([[xx, 0, 0], [0, yy, 0], [0, 0, zz]])
    return Inertia(mass, vector((0, 0, 0)), tensor).transform(pose(element, settings, values))


def _geom(element: Element, frame: Array, settings: Settings, values: Values) -> Inertia | None:
    shape = element.attributes.get("type", "mesh" if "mesh" in element.attributes else "sphere")
    if shape in MASSLESS or ("mass" in element.attributes and values.one(element, "mass") == 0):
        return None
    if shape not in SIZES or "mesh" in element.attributes:
        hint = "state <inertial> for its body: MuJoCo saves a file with it (mj_saveLastXML, saveinertial)"
        values.faults.warning(element.place, "the inertia of a mesh is left out: its file is not read", hint)
        return None
    if element.attributes.get("shellinertia", "false") == "true":
        values.faults.error(element.place_of("shellinertia"), "the inertia of a shell is not read", "state <inertial>")
        return None
    place, size = _place_and_size(element, shape, settings, values)
    if size is None:
        return None
    mass: Any = (
        values.one(element, "mass")
        if "mass" in element.attributes
        else values.one(element, "density", WATER) * volume(shape, size)
    )
    return inertia(shape, size, mass).transform(frame @ place)


def _place_and_size(element: Element, shape: str, settings: Settings, values: Values) -> tuple[Array, list[Any] | None]:
    """Pose and half sizes of a shape, which may be stated by its ends, ``fromto``."""
    given = values.numbers(element, "size", None) or []
    if "fromto" not in element.attributes:
        if len(given) < SIZES[shape]:
            message = f"size of a {shape} has {len(given)} numbers"
            values.faults.error(element.place_of("size"), message, f"{SIZES[shape]}, in m")
            return identity(), None
        return pose(element, settings, values), given[: SIZES[shape]]
    ends = values.numbers(element, "fromto", 6)
    if ends is None or not given:
        return identity(), None
    start, end = vector(ends[:3]), vector(ends[3:])
    half = norm(end - start) / 2
    R = to_axis(values.direction(element, "fromto", list(start - end)))
    radius = given[0]
    size = [radius, half] if SIZES[shape] == 2 else [radius, radius, half]
    return transform(R, list((start + end) / 2)), size


# ------------------------------------------------------------------------------------------------------------------
# MJCF, the XML of MuJoCo
# ------------------------------------------------------------------------------------------------------------------

KINDS = {"hinge": "revolute", "slide": "prismatic", "ball": "ball", "free": "free"}
REFUSED = {
    "include": "merge the files first: MuJoCo saves a merged one with mj_saveLastXML",
    "attach": "merge the models first: MuJoCo saves a merged one with mj_saveLastXML",
    "replicate": "expand it first: MuJoCo saves an expanded file with mj_saveLastXML",
    "composite": "expand it first: MuJoCo saves an expanded file with mj_saveLastXML",
    "flexcomp": "soft bodies have no place in a serial chain of rigid ones",
}
READ = ("worldbody", "compiler", "default", "option", "equality", "actuator", "tendon")
WORLD = "world"
MEDIUM = ("density", "viscosity", "wind")
FRICTIONS = {"damper": "damping", "passive": "damping", "frictionloss": "frictionloss", "constraint": "frictionloss"}
"""What the flags of MuJoCo disable of the friction of joints and tendons."""
_POSE = ("pos", "quat", "euler", "axisangle", "xyaxes", "zaxis")
ATTRIBUTES = {
    "body": ("name", "childclass", *_POSE, "gravcomp", "mocap", "sleep", "user"),
    "frame": ("name", "childclass", *_POSE),
    "inertial": ("mass", "diaginertia", "fullinertia", *_POSE),
    "freejoint": ("name", "group", "align"),
    "joint": tuple(
        """name class type pos axis range limited ref armature damping frictionloss stiffness springref springdamper
        springyield actuatorfrcrange actuatorfrclimited actuatorgravcomp group margin solimpfriction solimplimit
        solreffriction solreflimit user""".split()  # noqa: SIM905
    ),
}
"""The attributes that MuJoCo 4 knows, of elements in which further ones would change how the robot moves."""


def _read(source: Source, faults: FaultList) -> Found | None:
    root = parse_xml(source.text, faults)
    if root is None:
        return None
    for name in source.values:
        faults.error(None, f"--set {name}: an MJCF has no names with open values")
    if root.tag != "mujoco":
        faults.error(root.place, f"the root is <{root.tag}>", "an MJCF begins with <mujoco>")
    for element in root.walk():
        if element.tag in REFUSED:
            faults.error(element.place, f"<{element.tag}> is not read", REFUSED[element.tag])
    world = root.child("worldbody")
    if world is None:
        faults.error(root.place, "there is no <worldbody>", "bodies are described in it")
    if faults.errors or world is None:
        return None
    described = [element for element in world.walk() if element.tag in ATTRIBUTES]
    for body in described:
        refuse_repeated(body, ("inertial",), faults)
    refuse_unknown(described, ATTRIBUTES, (), faults)
    values = Values(faults, source.chain.angle_tolerance)
    reader = _MjcfReader(root, values, {source.chain.base, source.chain.tip} - {""})
    invented = _name_the_unnamed(world)
    reader.read_body(world, WORLD, "main")
    reader.read_equalities(root)
    if not source.chain.tip:
        reader.take_site_as_tip()
    if faults.errors:
        return None
    _tell_left_out(root, faults)
    actuators = Actuators(root, reader.settings, values, frozenset(reader.joints))
    tree = Tree(
        root.attributes.get("model", ""),
        WORLD,
        reader.bodies,
        tuple(actuators.complete_joint(joint) for joint in reader.joints.values()),
        reader.settings.gravity,
        actuators.shafts,
        root.place,
        tuple(reader.constraints),
    )
    robot = robot_of_tree(tree, source, values.rounded, faults)
    return replace(robot, text=xml_text(root)) if robot is not None and invented else robot


def _name_the_unnamed(world: Element) -> bool:
    """Give every body and joint a name, which the format does not demand; returns whether there was one without.

    A body is called by its number in the file, which is that of MuJoCo, a joint by its body and its number there.
    """
    bodies = [element for element in world.walk() if element.tag == "body"]
    joints = {id(body): [child for child in body.children if child.tag in ("joint", "freejoint")] for body in bodies}
    used = {element.attributes.get("name", "") for body in bodies for element in (body, *joints[id(body)])}
    invented = False
    for number_of_body, body in enumerate(bodies, 1):
        names = [(body, f"body {number_of_body}")]
        names += [(joint, f"_joint{k}") for k, joint in enumerate(joints[id(body)], 1)]
        for element, name in names:
            if element.attributes.get("name", "").strip():
                continue
            name = name if element is body else body.attributes["name"] + name
            while name in used:
                name += "_"
            used.add(name)
            element.attributes["name"] = name
            invented = True
    return invented


class _MjcfReader:
    """Collects the bodies and joints of a file; ``ends`` are the links that the user has named, which may be sites."""

    def __init__(self, root: Element, values: Values, ends: set[str]) -> None:
        self.values, self.faults, self.ends = values, values.faults, ends
        self.settings = Settings(root, values)
        self.bodies: dict[str, Body] = {}
        self.joints: dict[str, TreeJoint] = {}
        self.ref: dict[str, Any] = {}
        self.constraints: list[Constraint] = []
        self.body_of_site: dict[str, str] = {}
        self.mocap: set[str] = set()
        self.sites: dict[str, list[tuple[Element, Array]]] = {}
        """The named sites on each body that are no ends yet, with their poses (4, 4) in it."""

    def read_body(self, element: Element, name: str, inherited: str) -> None:
        """Read the inertia of a body, then its children; the body's own joint has been read before.

        ``inherited`` is the name of the class of defaults that applies to the body.
        """
        inertia = None if name == WORLD else body_inertia(element, inherited, self.settings, self.values)
        self.bodies[name] = Body(name, inertia, element.place)
        self._children(element, name, inherited, identity())

    def _children(self, element: Element, parent: str, inherited: str, frame: Array) -> None:
        """Read the bodies, frames and named sites in ``element``.

        ``frame`` (4, 4) is the pose of ``element`` in the body ``parent``, which differs from the identity inside a
        <frame>.
        """
        for child in element.children:
            if child.tag == "frame":
                for joint in (*child.all("joint"), *child.all("freejoint")):
                    hint = "state it in the body: MuJoCo saves a file in which it is (mj_saveLastXML)"
                    self.faults.error(joint.place, f"<{joint.tag}> in a <frame> is not read", hint)
                inner = frame @ pose(child, self.settings, self.values)
                self._children(child, parent, child.attributes.get("childclass", inherited), inner)
            elif child.tag == "body":
                self._body(child, parent, inherited, frame)
            elif child.tag == "site" and child.attributes.get("name"):
                place = frame @ pose(self.settings.with_defaults(child, inherited), self.settings, self.values)
                self.body_of_site[child.attributes["name"]] = parent
                if child.attributes["name"] in self.ends:
                    self._fixed_end(child, parent, place)
                else:
                    self.sites.setdefault(parent, []).append((child, place))

    def take_site_as_tip(self) -> None:
        """Take the only named site on the only last body as the tip, as exported tools are; say so, or that it is not.

        Without it the chain would end at the frame of the body, and the tool would be lost.
        """
        carriers = {joint.parent for joint in self.joints.values()}
        last = [name for name in self.bodies if name not in carriers]
        sites = self.sites.get(last[0], []) if len(last) == 1 else []
        if len(sites) == 1:
            site, place = sites[0]
            self._fixed_end(site, last[0], place)
            message = f"the tip is the site '{site.attributes['name']}' on '{last[0]}'"
            self.faults.warning(site.place, message, f"--tip {last[0]} ends the chain at the body")
        elif sites:
            named = ", ".join(site.attributes["name"] for site, _ in sites[:MAX_NAMED])
            self.faults.warning(sites[0][0].place, f"the tip is the body '{last[0]}'", f"--tip takes a site: {named}")

    def _fixed_end(self, site: Element, parent: str, place: Array) -> None:
        name = site.attributes["name"]
        self.bodies.setdefault(name, Body(name, None, site.place))
        self._fix(f"{name} on {parent}", parent, name, place, site)

    def _body(self, element: Element, parent: str, inherited: str, frame: Array) -> None:
        inherited = element.attributes.get("childclass", inherited)
        name = element.attributes["name"]
        if name in self.bodies:
            self.faults.error(element.place, f"there are two bodies '{name}'", "names are unique")
            return
        if element.attributes.get("mocap", "false") == "true":
            self.mocap.add(name)
        if self.values.one(element, "gravcomp", "0") != 0:
            message = f"the compensation of gravity of '{name}' is left out"
            self.faults.warning(element.place_of("gravcomp"), message, "torques are those without it")
        place = frame @ pose(element, self.settings, self.values)
        joints = [child for child in element.children if child.tag in ("joint", "freejoint")]
        for child in joints:
            parent, place = self._joint(child, parent, place, name, inherited)
        self._fix(f"{name} on {parent}", parent, name, place, element)
        self.read_body(element, name, inherited)

    def _fix(self, name: str, parent: str, child: str, origin: Array, element: Element) -> None:
        self.joints[name] = TreeJoint(name, "fixed", parent, child, origin, vector((0, 0, 1)), element.place)

    def _joint(self, given: Element, parent: str, place: Array, owner: str, inherited: str) -> tuple[str, Array]:
        """Read one joint of the body ``owner``; an MJCF body may have several, stacked one behind the other.

        It becomes a joint between the body ``parent`` and a new massless body; ``place`` is the owner's pose in
        ``parent``. Returns the new body's name and the owner's pose in it.
        """
        element = self.settings.with_defaults(given, inherited)
        word = "free" if given.tag == "freejoint" else element.attributes.get("type", "hinge")
        name = element.attributes["name"].strip()
        if word not in KINDS or name in self.joints:
            wrong = f"the type of joint '{name}' is '{word}'" if word not in KINDS else f"there are two joints '{name}'"
            self.faults.error(given.place_of("type"), wrong, f"types are {', '.join(KINDS)}; names are unique")
            return parent, place
        kind = KINDS[word]
        axis = self.values.direction(element, "axis", self.values.three(element, "axis", "0 0 1"))
        at = transform(identity(3), self.values.three(element, "pos"))
        back = transform(identity(3), [-x for x in at[:3, 3]])
        ref = self._joint_value(element, "ref", kind)
        behind = f"{owner} behind {name}"
        self.bodies[behind] = Body(behind, None, given.place)
        joint = TreeJoint(name, kind, parent, behind, place @ at, axis, given.place)
        origin = joint.origin @ motion(joint, -ref)
        self.joints[name] = TreeJoint(
            name,
            kind,
            parent,
            behind,
            origin,
            axis,
            given.place,
            self._limits(element, kind),
            friction_of(element, self.settings, self.values),
            self._drive(element),
        )
        self.ref[name] = ref
        if any(x != 0 for x in self.values.numbers(element, "stiffness", None, "0") or ()):
            self.faults.warning(given.place, f"the spring of joint '{name}' is left out", "a robot file has no springs")
        if _has_spring_damper(element, self.values):
            message = f"spring and damper of joint '{name}' are left out"
            hint = "springdamper replaces damping=; MuJoCo saves a file that states the latter (mj_saveLastXML)"
            self.faults.warning(given.place_of("springdamper"), message, hint)
        return behind, back

    def _joint_value(self, element: Element, name: str, kind: str) -> Any:
        value = self.values.one(element, name, "0")
        return self.values.angle(value * self.settings.angle) if kind == "revolute" else value

    def _limits(self, element: Element, kind: str) -> Limits:
        span = self.values.numbers(element, "range", 2) if "range" in element.attributes else None
        force = (
            self.values.numbers(element, "actuatorfrcrange", 2) if "actuatorfrcrange" in element.attributes else None
        )
        limits: dict[str, float] = {}
        if span and span[0] > span[1]:
            message = f"range of <joint> is {float(span[0]):g} to {float(span[1]):g}"
            self.faults.error(element.place_of("range"), message, "the lower end first")
        if span and self.settings.is_limited(element, "") and span[0] < span[1]:
            scale = self.settings.angle if kind == "revolute" else number(1)
            limits |= {"lower": float(span[0] * scale), "upper": float(span[1] * scale)}
        if force and self.settings.is_limited(element, "actuatorfrc") and force[1] > 0:
            limits["torque"] = float(min(force[1], -force[0]) if force[0] < 0 else force[1])
        return Limits(**limits)

    def _drive(self, element: Element) -> DriveSpec | None:
        armature = self.values.not_negative(element, "armature")
        return DriveSpec(inertia=armature) if armature else None

    def read_equalities(self, root: Element) -> None:
        """Read linear equalities between two joints as one joint following the other.

        Others between bodies become ``constraints``; the rest and those that are not active cause a warning.
        """
        for given in (child for part in root.all("equality") for child in part.children):
            element = self.settings.with_defaults(given, "main", "equality")
            if self.settings.disabled & {"equality", "constraint"} or element.attributes.get("active") == "false":
                message = f"the equality <{element.tag}> is left out: it is not active"
                self.faults.warning(element.place, message, "a robot file has those that are active")
                continue
            first, second = (element.attributes.get(key, "") for key in ("joint1", "joint2"))
            c = self.values.numbers(element, "polycoef", None, "0 1 0 0 0") if element.tag == "joint" else None
            linear = c is not None and len(c) >= 2 and not any(x != 0 for x in c[2:])
            if element.tag == "joint" and linear and self._unknown(element, root):
                continue
            if not linear or first not in self.joints or second not in self.joints or c is None:
                if bodies := self._find_bodies(element):
                    self.constraints.append(Constraint(f"equality <{element.tag}>", bodies, element.place))
                    continue
                hint = "a robot file couples joints linearly: <joint joint1= joint2= polycoef= />"
                self.faults.warning(element.place, f"the equality <{element.tag}> is left out", hint)
                continue
            offset = c[0] + self.ref[first] - c[1] * self.ref[second]  # in rad (m) whatever the unit of angles
            self.joints[first] = replace(self.joints[first], mimic=Mimic(second, c[1], offset))

    def _find_bodies(self, element: Element) -> tuple[str, str] | None:
        """The bodies between which an equality holds; None where there are none, and for bodies that a program moves.

        An equality about a joint holds between the bodies at its sides.
        """
        joint = self.joints.get(element.attributes.get("joint1", "")) if element.tag == "joint" else None
        if joint is not None:
            return joint.parent, joint.child
        if element.tag not in ("weld", "connect"):
            return None
        what, known = ("site", self.body_of_site) if "site1" in element.attributes else ("body", self.bodies)
        ends = []
        for key in (f"{what}1", f"{what}2"):
            name = element.attributes.get(key, WORLD)
            if name not in known:
                self.faults.error(element.place_of(key), f"there is no {what} '{name}'", did_you_mean(name, known))
                return None
            ends.append(self.body_of_site[name] if what == "site" else name)
        return None if self.mocap & set(ends) else (ends[0], ends[1])

    def _unknown(self, element: Element, root: Element) -> bool:
        """Whether an equality names a joint that the file does not have, which is a fault."""
        names = [joint.attributes.get("name", "") for joint in root.walk() if joint.tag in ("joint", "freejoint")]
        missing = [key for key in ("joint1", "joint2") if element.attributes.get(key) not in (None, *names)]
        for key in missing:
            name = element.attributes[key]
            self.faults.error(element.place_of(key), f"there is no joint '{name}'", did_you_mean(name, names))
        return bool(missing)


def _tell_left_out(root: Element, faults: FaultList) -> None:
    """Warn once per kind of top-level element that has no place in a robot file, at the first of its kind.

    Warn of a medium around the robot too, and of friction that the file disables.
    """
    for option in root.all("option"):
        medium = [name for name in MEDIUM if set(option.attributes.get(name, "0").split()) - {"0", "0.0"}]
        if medium:
            message = f"the medium is left out: {', '.join(medium)} of <option>"
            faults.warning(option.place_of(medium[0]), message, "a robot file has no forces of a fluid")
        for flag in option.all("flag"):
            for name in (name for name in FRICTIONS if flag.attributes.get(name) == "disable"):
                message = f"{FRICTIONS[name]} of all joints is left out: <flag> disables it"
                faults.warning(flag.place_of(name), message, "a robot file has what is active")
    count = Counter(child.tag for child in root.children if child.tag not in READ and child.children)
    for tag, times in count.items():
        first = root.child(tag)
        assert first is not None
        more = f", {times} times" if times > 1 else ""
        faults.warning(first.place, f"<{tag}> is left out{more}", "a robot file has no such entry")


IMPORTER = Importer(
    "mjcf",
    "MJCF of MuJoCo: the serial chain between two bodies, --base and --tip",
    (".xml", ".mjcf"),
    lambda text: re.search(r"<mujoco[\s>/]", text) is not None,
    _read,
    describes_trees=True,
)
