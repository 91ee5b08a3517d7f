"""MJCF, the XML of MuJoCo: the serial chain from a chosen body to a chosen body or site becomes a robot file.

The pose of a body is ``pos`` and ``quat`` (or another rotation) in its parent; its joints, in their order, rotate about
or shift along axes that are given in the frame of the body. Angles are in degrees unless the element ``compiler`` says
otherwise. A body without ``inertial`` has the inertia of its geoms; that of meshes cannot be computed here, which a
warning says.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from typing import Any

from rrrgen.base.yamltext.document import FaultList
from rrrgen.base.yamltext.suggest import did_you_mean
from rrrgen.robot.importers.interface import Found, Importer, Source
from rrrgen.robot.importers.mjcf_actuators import Actuators, friction_of
from rrrgen.robot.importers.mjcf_bodies import body_inertia
from rrrgen.robot.importers.mjcf_settings import Settings, pose
from rrrgen.robot.importers.trees.exact_numbers import Array, identity, number, transform, vector
from rrrgen.robot.importers.trees.serial_chain import MAX_NAMED, motion
from rrrgen.robot.importers.trees.tree import Body, Mimic, Tree, TreeJoint
from rrrgen.robot.importers.trees.tree_import import robot_of_tree
from rrrgen.robot.importers.trees.xml_tree import Element, parse_xml
from rrrgen.robot.importers.trees.xml_values import Values, refuse_repeated, refuse_unknown
from rrrgen.robot.robot_spec import DriveSpec, Limits

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
    reader = _Reader(root, values, {source.chain.base, source.chain.tip} - {""})
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
        tuple(actuators.with_limit(joint) for joint in reader.joints.values()),
        reader.settings.gravity,
        actuators.shafts,
    )
    return robot_of_tree(tree, source, values.rounded, faults)


class _Reader:
    """Collects the bodies and joints of a file; ``ends`` are the links that the user has named, which may be sites."""

    def __init__(self, root: Element, values: Values, ends: set[str]) -> None:
        self.values, self.faults, self.ends = values, values.faults, ends
        self.settings = Settings(root, values)
        self.bodies: dict[str, Body] = {}
        self.joints: dict[str, TreeJoint] = {}
        self.ref: dict[str, Any] = {}
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
                inner = frame @ pose(child, self.settings, self.values)
                self._children(child, parent, child.attributes.get("childclass", inherited), inner)
            elif child.tag == "body":
                self._body(child, parent, inherited, frame)
            elif child.tag == "site" and child.attributes.get("name"):
                place = frame @ pose(self.settings.with_defaults(child, inherited), self.settings, self.values)
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
        name = element.attributes.get("name", "")
        name = name or f"body {len(self.bodies)}"
        if name in self.bodies:
            self.faults.error(element.place, f"there are two bodies '{name}'", "names are unique")
            return
        if self.values.one(element, "gravcomp", "0") != 0:
            message = f"the compensation of gravity of '{name}' is left out"
            self.faults.warning(element.place_of("gravcomp"), message, "torques are those without it")
        place = frame @ pose(element, self.settings, self.values)
        joints = [child for child in element.children if child.tag in ("joint", "freejoint")]
        for k, child in enumerate(joints):
            parent, place = self._joint(child, parent, place, name, k, inherited)
        self._fix(f"{name} on {parent}", parent, name, place, element)
        self.read_body(element, name, inherited)

    def _fix(self, name: str, parent: str, child: str, origin: Array, element: Element) -> None:
        self.joints[name] = TreeJoint(name, "fixed", parent, child, origin, vector((0, 0, 1)), element.place)

    def _joint(
        self, given: Element, parent: str, place: Array, owner: str, k: int, inherited: str
    ) -> tuple[str, Array]:
        """Read one joint of the body ``owner``; an MJCF body may have several, stacked one behind the other.

        It becomes joint number ``k`` (from 0) of the owner, between the body ``parent`` and a new massless body;
        ``place`` is the owner's pose in ``parent``. Returns the new body's name and the owner's pose in it.
        """
        element = self.settings.with_defaults(given, inherited)
        word = "free" if given.tag == "freejoint" else element.attributes.get("type", "hinge")
        name = element.attributes.get("name", f"{owner}_joint{k + 1}")
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
            friction_of(element, self.values),
            self._drive(element),
        )
        self.ref[name] = ref
        if any(x != 0 for x in self.values.numbers(element, "stiffness", None, "0") or ()):
            self.faults.warning(given.place, f"the spring of joint '{name}' is left out", "a robot file has no springs")
        return behind, back

    def _joint_value(self, element: Element, name: str, kind: str) -> Any:
        value = self.values.one(element, name, "0")
        return self.values.angle(value * self.settings.angle) if kind == "revolute" else value

    def _limits(self, element: Element, kind: str) -> Limits:
        limited = element.attributes.get("limited", "auto")
        span = self.values.numbers(element, "range", 2) if "range" in element.attributes else None
        force = (
            self.values.numbers(element, "actuatorfrcrange", 2) if "actuatorfrcrange" in element.attributes else None
        )
        found: dict[str, float] = {}
        if span and span[0] > span[1]:
            message = f"range of <joint> is {float(span[0]):g} to {float(span[1]):g}"
            self.faults.error(element.place_of("range"), message, "the lower end first")
        if span and (limited == "true" or (limited == "auto" and self.settings.auto_limits)) and span[0] < span[1]:
            scale = self.settings.angle if kind == "revolute" else number(1)
            found |= {"lower": float(span[0] * scale), "upper": float(span[1] * scale)}
        if force and force[1] > 0:
            found["torque"] = float(min(force[1], -force[0]) if force[0] < 0 else force[1])
        return Limits(**found)

    def _drive(self, element: Element) -> DriveSpec | None:
        armature = self.values.not_negative(element, "armature")
        return DriveSpec(inertia=armature) if armature else None

    def read_equalities(self, root: Element) -> None:
        """Read linear equalities between two joints as one joint following the other; others cause a warning."""
        for element in (child for part in root.all("equality") for child in part.children):
            first, second = (element.attributes.get(key, "") for key in ("joint1", "joint2"))
            c = self.values.numbers(element, "polycoef", None, "0 1 0 0 0") if element.tag == "joint" else None
            linear = c is not None and len(c) >= 2 and not any(x != 0 for x in c[2:])
            if element.tag == "joint" and linear and self._unknown(element, root):
                continue
            if not linear or first not in self.joints or second not in self.joints or c is None:
                hint = "a robot file couples joints linearly: <joint joint1= joint2= polycoef= />"
                self.faults.warning(element.place, f"the equality <{element.tag}> is left out", hint)
                continue
            offset = c[0] + self.ref[first] - c[1] * self.ref[second]  # in rad (m) whatever the unit of angles
            self.joints[first] = replace(self.joints[first], mimic=Mimic(second, c[1], offset))

    def _unknown(self, element: Element, root: Element) -> bool:
        """Whether an equality names a joint that the file does not have, which is a fault."""
        names = [joint.attributes.get("name", "") for joint in root.walk() if joint.tag in ("joint", "freejoint")]
        missing = [key for key in ("joint1", "joint2") if element.attributes.get(key) not in (None, *names)]
        for key in missing:
            name = element.attributes[key]
            self.faults.error(element.place_of(key), f"there is no joint '{name}'", did_you_mean(name, names))
        return bool(missing)


def _tell_left_out(root: Element, faults: FaultList) -> None:
    """Warn once per kind of top-level element that has no place in a robot file, at the first of its kind."""
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
