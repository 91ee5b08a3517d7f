"""URDF: a tree of links and joints in XML; the serial chain from a chosen base to a chosen tip becomes a robot file.

The pose of a child link is ``origin`` (xyz in m; rpy in rad: ``Rz(yaw) Ry(pitch) Rx(roll)``) times the motion along
``axis``, which is stated in the frame of the child. Inertia is about the centre of mass, with tensor signs. A URDF has
no gravity: (0, 0, -9.81) m/s^2 in the frame of its root is taken.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import Any

from rrrgen.base.yamltext.document import FaultList
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.robot.importers.interface import Found, Importer, Source
from rrrgen.robot.importers.trees.bodies import Body, Inertia, Mimic, Tree, TreeJoint
from rrrgen.robot.importers.trees.denavit_hartenberg import robot_of_tree
from rrrgen.robot.importers.trees.exact_numbers import (
    Array,
    identity,
    roll_pitch_yaw,
    transform,
    vector,
    without_noise,
)
from rrrgen.robot.importers.trees.xml import Element, Values, parse_xml, refuse_repeated, refuse_unknown
from rrrgen.robot.spec import DriveSpec, FrictionSpec, Limits

KINDS = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "fixed": "fixed"}
UNSUPPORTED = ("floating", "planar", "spherical")
NO_LIMIT = 1e9
GRAVITY = ("0", "0", "-9.81")
READ = {
    "robot": ("link", "joint", "transmission"),
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic"),
}
"""The elements that are read, by the element that contains them; a warning names every other one as left out."""

ATTRIBUTES = {
    "robot": ("name", "version"),
    "link": ("name", "type"),
    "inertial": (),
    "joint": ("name", "type"),
    "limit": ("lower", "upper", "effort", "velocity"),
    "dynamics": ("damping", "friction"),
    "origin": ("xyz", "rpy"),
    "axis": ("xyz",),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "parent": ("link",),
    "child": ("link",),
    "mimic": ("joint", "multiplier", "offset"),
}
"""The attributes of the elements that are read."""

EXACT = ("origin", "axis", "mass", "inertia", "parent", "child", "mimic")
"""Elements in which a further attribute would change how the robot moves."""


def _read(source: Source, faults: FaultList) -> Found | None:
    root = parse_xml(source.text, faults)
    if root is None:
        return None
    for name in source.values:
        faults.error(None, f"--set {name}: a URDF has no names with open values")
    _refuse_macros(root, faults)
    if root.tag != "robot":
        faults.error(root.place, f"the root is <{root.tag}>", "a URDF begins with <robot name=...>")
    if faults.errors:
        return None
    _check_elements(root, faults)
    values = Values(faults, source.chain.angle_tolerance)
    bodies = _bodies(root, values)
    joints = _joints(root, bodies, values)
    base = _root_of(bodies, joints, root, faults)
    if faults.errors or base is None:
        return None
    _tell_left_out(root, faults)
    faults.warning(root.place, "a URDF has no gravity", "(0, 0, -9.81) m/s^2 in the frame of its root is taken")
    name = root.attributes.get("name", "")
    tree = Tree(name, base, bodies, tuple(joints), vector(GRAVITY), place=root.place)
    return robot_of_tree(tree, source, values.rounded, faults)


def _refuse_macros(root: Element, faults: FaultList) -> None:
    for element in root.walk():
        if element.tag.startswith("xacro:"):
            faults.error(element.place, f"<{element.tag}> is a macro", "expand the file first: xacro FILE > robot.urdf")
            return


def _check_elements(root: Element, faults: FaultList) -> None:
    """Report unknown attributes, and elements that stand twice where one is read, in all that is read."""
    links, read = root.all("link"), [root]
    for owner in (*links, *root.all("joint"), *(inertial for link in links for inertial in link.all("inertial"))):
        refuse_repeated(owner, READ[owner.tag], faults)
        parts = (child for child in owner.children if child.tag in READ[owner.tag])
        read += [owner, *(child for child in parts if child.tag != "inertial")]
    refuse_unknown(read, ATTRIBUTES, EXACT, faults)


def _origin(element: Element, values: Values) -> Array:
    origin = element.child("origin")
    if origin is None:
        return identity()
    rpy = [values.angle(angle) for angle in values.three(origin, "rpy")]
    return transform(roll_pitch_yaw(*rpy), [without_noise(x) for x in values.three(origin, "xyz")])


def _bodies(root: Element, values: Values) -> dict[str, Body]:
    bodies: dict[str, Body] = {}
    for link in root.all("link"):
        name = link.attributes.get("name", "")
        if not name or name in bodies:
            what = f"there are two links '{name}'" if name else "a link has no name"
            values.faults.error(link.place, what, "every link has a name of its own")
        bodies[name] = Body(name, _inertia(link, values), link.place)
    if not bodies:
        values.faults.error(root.place, "there is no <link>", "a robot has links and joints")
    return bodies


def _inertia(link: Element, values: Values) -> Inertia | None:
    inertial = link.child("inertial")
    if inertial is None:
        return None
    mass, tensor = inertial.child("mass"), inertial.child("inertia")
    if mass is None or tensor is None:
        missing = "<mass>" if mass is None else "<inertia>"
        values.faults.error(inertial.place, f"<inertial> has no {missing}", '<mass value="..."/> and <inertia .../>')
        return None
    m = values.one(mass, "value")
    if m < 0:
        values.faults.error(mass.place_of("value"), "the mass is negative")
    if absent := [f"i{key}" for key in _ENTRIES[3:] if f"i{key}" not in tensor.attributes]:
        message = f"<inertia> has no {', '.join(absent)}"
        values.faults.warning(tensor.place, message, "taken as 0; many programs drop the inertia of such a link")
    entries = {key: values.one(tensor, f"i{key}", "0" if key[0] != key[1] else None) for key in _ENTRIES}
    rows = [[entries[min(a + b, b + a)] for b in "xyz"] for a in "xyz"]
    at_com = Inertia(m, vector((0, 0, 0)), 0 * identity(3) + rows)
    return at_com.transform(_origin(inertial, values))


_ENTRIES = ("xx", "yy", "zz", "xy", "xz", "yz")


def _joints(root: Element, bodies: dict[str, Body], values: Values) -> list[TreeJoint]:
    joints: dict[str, TreeJoint] = {}
    gears = _gear_ratios(root, values)
    for element in root.all("joint"):
        joint = _joint(element, bodies, gears, values)
        if joint is None:
            continue
        if joint.name in joints:
            values.faults.error(element.place, f"there are two joints '{joint.name}'", "names are unique")
        joints[joint.name] = joint
    for name, joint in joints.items():
        if joint.mimic is not None and joint.mimic.of not in joints:
            hint = did_you_mean(joint.mimic.of, joints)
            values.faults.error(joint.place, f"joint '{name}' follows '{joint.mimic.of}', which does not exist", hint)
    return list(joints.values())


def _joint(element: Element, bodies: dict[str, Body], gears: dict[str, float], values: Values) -> TreeJoint | None:
    faults = values.faults
    name, word = element.attributes.get("name", ""), element.attributes.get("type", "")
    if not name:
        faults.error(element.place, "a joint has no name", '<joint name="..." type="revolute">')
    if word not in KINDS and word not in UNSUPPORTED:
        hint = did_you_mean(word, (*KINDS, *UNSUPPORTED)) or f"types are {', '.join((*KINDS, *UNSUPPORTED))}"
        faults.error(element.place_of("type"), f"the type of joint '{name}' is '{word}'", hint)
    ends = [_end(element, tag, bodies, faults) for tag in ("parent", "child")]
    kind = KINDS.get(word, word)
    axis = vector((1, 0, 0))
    if kind in ("revolute", "prismatic") and (stated := element.child("axis")) is not None:
        axis = values.direction(stated, "xyz", values.three(stated, "xyz", None))
    origin = _origin(element, values)
    limits = _limits(element, word, values)
    if None in ends:
        return None
    return TreeJoint(
        name=name,
        kind=kind,
        parent=str(ends[0]),
        child=str(ends[1]),
        origin=origin,
        axis=axis,
        place=element.place,
        limits=limits,
        friction=_friction(element, values),
        drive=DriveSpec(gear_ratio=gears[name]) if name in gears else None,
        mimic=_mimic(element, values),
    )


def _end(element: Element, tag: str, bodies: dict[str, Body], faults: FaultList) -> str | None:
    end = element.child(tag)
    if end is None:
        faults.error(element.place, _no_end(element, tag), f'<{tag} link="..."/>')
        return None
    name = end.attributes.get("link", "")
    if name not in bodies:
        faults.error(end.place_of("link"), f"there is no link '{name}'", did_you_mean(name, bodies))
        return None
    return name


def _no_end(element: Element, tag: str) -> str:
    return f"joint '{element.attributes.get('name', '')}' has no <{tag}>"


def _limits(element: Element, word: str, values: Values) -> Limits:
    """The limits of a joint of the type ``word``, as the file spells it; a continuous joint has no position limits.

    Zero speeds and efforts, which exporters write for unknown ones, are left out with a warning.
    """
    limit = element.child("limit")
    if limit is None:
        return Limits()
    limits: dict[str, float | None] = {}
    for key, field in (("velocity", "velocity"), ("effort", "torque")):
        value = values.float_or_none(limit, key, math.inf)
        if value is not None and value <= 0:
            values.faults.warning(limit.place_of(key), f"the {key} limit {value:g} is left out", "it would be no limit")
            value = None
        limits[field] = _limit_or_none(value)
    if word != "continuous":
        lower, upper = (values.float_or_none(limit, key, math.inf) for key in ("lower", "upper"))
        if lower is not None or upper is not None:
            lower, upper = lower or 0.0, upper or 0.0  # the format's defaults
            if lower < upper:
                limits |= {"lower": _limit_or_none(lower), "upper": _limit_or_none(upper)}
            else:
                message = f"the limits {lower:g} and {upper:g} of '{element.attributes.get('name', '')}' are left out"
                values.faults.warning(limit.place, message, "lower is below upper")
    return Limits(**limits)


def _limit_or_none(limit: float | None) -> float | None:
    """The limit, or None for a number above 1e9: files write that for "no limit", as the format demands a value."""
    return None if limit is None or abs(limit) >= NO_LIMIT else limit


def _friction(element: Element, values: Values) -> FrictionSpec | None:
    """Read viscous and Coulomb friction; zeros, which exporters write for unknown values, count as not stated."""
    dynamics = element.child("dynamics")
    if dynamics is None:
        return None
    viscous, coulomb = (values.not_negative(dynamics, key) or None for key in ("damping", "friction"))
    return None if viscous is None and coulomb is None else FrictionSpec(viscous=viscous, coulomb=coulomb)


def _mimic(element: Element, values: Values) -> Mimic | None:
    mimic = element.child("mimic")
    if mimic is None:
        return None
    multiplier, offset = values.one(mimic, "multiplier", "1"), values.one(mimic, "offset", "0")
    return Mimic(mimic.attributes.get("joint", ""), multiplier, offset)


def _gear_ratios(root: Element, values: Values) -> dict[str, float]:
    """Read the gear ratios, by joint name, of transmissions from one motor to one joint; others cause a warning."""
    gears: dict[str, float] = {}
    for transmission in root.all("transmission"):
        reductions = [e for e in transmission.walk() if e.tag == "mechanicalReduction"]
        joints = transmission.all("joint")
        simple = len(joints) == 1 and len(reductions) == 1
        text = reductions[0].text.strip() if reductions else ""
        if simple and re.fullmatch(r"-?\d{1,9}(\.\d{1,9})?", text, re.ASCII) and float(text) != 0:
            gears[joints[0].attributes.get("name", "")] = float(text)
        elif reductions:
            name = transmission.attributes.get("name", "")
            hint = "a joint with one motor has drive: {gear_ratio: ...}; coupled drives are the section drives"
            values.faults.warning(transmission.place, f"the transmission '{name}' is left out", hint)
    return {name: ratio for name, ratio in gears.items() if ratio != 1}


def _root_of(bodies: dict[str, Body], joints: list[TreeJoint], root: Element, faults: FaultList) -> str | None:
    """The link that no joint carries; faults where links are carried twice, or the joints are no tree."""
    above: dict[str, TreeJoint] = {}
    for joint in joints:
        if joint.child in above:
            hint = f"joint '{above[joint.child].name}' carries it already; a loop has no place in a URDF"
            faults.error(joint.place, f"two joints carry the link '{joint.child}'", hint)
        above[joint.child] = joint
    roots = [name for name in bodies if name not in above]
    if len(roots) != 1:
        named = ", ".join(roots[:8]) if roots else "none"
        hint = "every link but one is the child of a joint"
        faults.error(root.place, f"{len(roots)} links are carried by no joint: {named}", hint)
        return None
    for name in bodies:
        seen = set()
        while name in above and name not in seen:
            seen.add(name)
            name = above[name].parent
        if name != roots[0]:
            faults.error(above[name].place, f"the links around '{name}' carry each other", "joints are a tree")
            return None
    return roots[0]


def _tell_left_out(root: Element, faults: FaultList) -> None:
    """Warn once per kind of element that has no place in a robot file, at the first element of that kind."""
    first: dict[str, Element] = {}
    count: Counter[str] = Counter()
    for element in (root, *root.all("link"), *root.all("joint"), *(e for e in root.walk() if e.tag == "inertial")):
        for child in element.children:
            if child.tag not in READ[element.tag]:
                count[child.tag] += 1
                first.setdefault(child.tag, child)
    for tag, element in first.items():
        times = f", {count[tag]} times" if count[tag] > 1 else ""
        faults.warning(element.place, f"<{tag}> is left out{times}", _REASONS.get(tag, _NO_ENTRY))


_NO_ENTRY = "a robot file has no such entry"
_REASONS: dict[str, Any] = {
    "visual": "a robot file has no shapes",
    "collision": "a robot file has no shapes",
    "material": "a robot file has no shapes",
    "gazebo": "settings of a simulator",
    "safety_controller": "soft limits belong to a controller",
    "calibration": "where reference marks lie belongs to a controller",
}

IMPORTER = Importer(
    "urdf",
    "URDF: the serial chain between two links, --base and --tip",
    (".urdf",),
    lambda text: re.search(r"<robot[\s>]", text) is not None,
    _read,
    describes_trees=True,
)
