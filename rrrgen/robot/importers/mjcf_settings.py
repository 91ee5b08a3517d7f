"""Settings of an MJCF that apply to many elements: units, Euler sequence, gravity, classes of defaults; poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from rrrgen.base.yamltext.suggest import did_you_mean
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
from rrrgen.robot.importers.trees.xml_tree import Element
from rrrgen.robot.importers.trees.xml_values import Values

ROTATIONS = ("quat", "euler", "axisangle", "xyaxes", "zaxis")
DEGREE = HIGH.pi / 180


class Settings:
    """Settings of a MuJoCo model (MJCF), read from its elements ``compiler``, ``option`` and ``default``."""

    def __init__(self, root: Element, values: Values) -> None:
        compilers = root.all("compiler")
        stated = {key: value for compiler in compilers for key, value in compiler.attributes.items()}
        self.angle: Any = number(1) if stated.get("angle") == "radian" else DEGREE
        self.sequence = stated.get("eulerseq", "xyz")
        self.auto_limits = stated.get("autolimits", "true") == "true"
        self.from_geoms = stated.get("inertiafromgeom", "auto")
        self.gravity = vector((0, 0, "-9.81"))
        for compiler in compilers:
            self._check(compiler, values)
        for option in root.all("option"):
            if "gravity" in option.attributes:
                self.gravity = vector(values.three(option, "gravity"))
        self.defaults: dict[str, dict[str, dict[str, str]]] = {"main": {}}
        for default in root.all("default"):
            self._read_class(default, None)
        for element in (each for part in root.children if part.tag != "default" for each in part.walk()):
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
                known.setdefault(child.tag, {}).update(child.attributes)
        self.defaults[name] = known
        for child in element.all("default"):
            self._read_class(child, name)

    def with_defaults(self, element: Element, inherited: str) -> Element:
        """Complete ``element`` by the defaults of its class, or of the class ``inherited`` from bodies around it."""
        chosen = self.defaults.get(element.attributes.get("class", inherited), {}).get(element.tag, {})
        return Element(
            element.tag, {**chosen, **element.attributes}, element.place, element.children, places=element.places
        )


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
