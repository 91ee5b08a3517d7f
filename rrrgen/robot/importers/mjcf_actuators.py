"""Actuators and fixed tendons of an MJCF: torque limits of joints, and motors that move several joints."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from rrrgen.robot.importers.mjcf_settings import Settings
from rrrgen.robot.importers.trees.tree import Shaft, TreeJoint
from rrrgen.robot.importers.trees.xml_tree import Element
from rrrgen.robot.importers.trees.xml_values import Values
from rrrgen.robot.robot_spec import FrictionSpec


def friction_of(element: Element, values: Values) -> FrictionSpec | None:
    """Viscous and Coulomb friction of a joint or a tendon; None where it states none, or zero."""
    damping = values.numbers(element, "damping", None, "0") or [0]
    if any(x != 0 for x in damping[1:]):
        values.faults.warning(element.place, "damping of higher order is left out", "friction is viscous and Coulomb")
    if damping[0] < 0:
        values.faults.error(
            element.place_of("damping"), f"damping of <{element.tag}> is {float(damping[0]):g}", "0 or more"
        )
    viscous, coulomb = float(damping[0]), values.not_negative(element, "frictionloss")
    return FrictionSpec(viscous=viscous or None, coulomb=coulomb or None) if viscous or coulomb else None


class Actuators:
    """Torque limits by the joint or the tendon that an actuator drives, and the fixed tendons as ``shafts``."""

    def __init__(self, root: Element, settings: Settings, values: Values, joints: Collection[str]) -> None:
        self.settings, self.values = settings, values
        self.limits: dict[str, float] = {}
        for part in root.all("actuator"):
            for element in part.children:
                self._read_actuator(settings.with_defaults(element, "main"))
        tendons = [element for part in root.all("tendon") for element in part.children]
        self.shafts = tuple(found for element in tendons if (found := self._shaft(element, joints)) is not None)

    def with_limit(self, joint: TreeJoint) -> TreeJoint:
        """Give ``joint`` the torque limit of its actuator, unless it has a limit of its own."""
        limit = self.limits.get(f"joint {joint.name}")
        if limit is None or joint.limits.torque is not None:
            return joint
        return replace(joint, limits=replace(joint.limits, torque=limit))

    def _read_actuator(self, element: Element) -> None:
        """Record the torque limit: the largest torque that the actuator reaches in both directions.

        It is ``gear`` times the smaller end of ``forcerange``, or of ``ctrlrange`` for a motor, whichever is less.
        """
        kind = next((key for key in ("joint", "tendon") if key in element.attributes), None)
        gears = self.values.numbers(element, "gear", None, "1")
        if kind is None or not gears:
            hint = "torque limits are those of joints and coupled drives"
            self.values.faults.warning(element.place, f"the actuator <{element.tag}> is left out", hint)
            return
        found = []
        for name in ("forcerange", *(("ctrlrange",) if element.tag == "motor" else ())):
            span = self.values.numbers(element, name, 2) if name in element.attributes else None
            if span and span[0] < 0 < span[1]:
                found.append(float(min(-span[0], span[1]) * abs(gears[0])))
        if found and min(found) > 0:
            self.limits[f"{kind} {element.attributes[kind]}"] = min(found)

    def _shaft(self, element: Element, joints: Collection[str]) -> Shaft | None:
        name = element.attributes.get("name", "")
        if element.tag != "fixed":
            self.values.faults.warning(element.place, f"the tendon '{name}' is left out", "only fixed tendons are read")
            return None
        weights = {}
        for each in element.all("joint"):
            joint = each.attributes.get("joint", "")
            if joint not in joints:
                self.values.faults.error(each.place_of("joint"), f"there is no joint '{joint}'")
            weights[joint] = self.values.one(each, "coef")
        if any(x != 0 for x in self.values.numbers(element, "stiffness", None, "0") or ()):
            self.values.faults.warning(element.place, f"the spring of tendon '{name}' is left out", "there are none")
        inertia = self.values.not_negative(element, "armature") or None
        limit = self.limits.get(f"tendon {name}")
        return Shaft(name, weights, inertia, friction_of(element, self.values), limit, element.place)
