"""Inertia of a body of an MJCF: the one stated in its element ``inertial``, or that of its shapes (geoms)."""

from __future__ import annotations

from typing import Any

from rrrgen.robot.importers.mjcf_settings import Settings, pose, to_axis
from rrrgen.robot.importers.trees.exact_numbers import Array, identity, norm, number, transform, vector
from rrrgen.robot.importers.trees.shapes import SIZES, inertia, volume
from rrrgen.robot.importers.trees.tree import Inertia, vector_rows
from rrrgen.robot.importers.trees.xml_tree import Element
from rrrgen.robot.importers.trees.xml_values import Values

WATER = "1000"  # kg/m^3, the density of a geom that states neither density nor mass
MASSLESS = ("plane", "hfield")


def body_inertia(element: Element, inherited: str, settings: Settings, values: Values) -> Inertia | None:
    """The inertia of a body in its frame; None where it has none, or only meshes."""
    stated = element.child("inertial")
    if stated is not None and settings.from_geoms != "true":
        return _stated(stated, settings, values)
    if settings.from_geoms == "false":
        return None
    total: Inertia | None = None
    for geom, frame, place_class in _geoms(element, inherited, identity(), settings, values):
        found = _geom(settings.with_defaults(geom, place_class), frame, settings, values)
        if found is not None:
            total = found if total is None else total + found
    return total


def _geoms(
    element: Element, inherited: str, frame: Array, settings: Settings, values: Values
) -> list[tuple[Element, Array, str]]:
    """All geoms of a body, nested frames included: (geom, pose (4, 4) of its frame in the body, default class)."""
    found = [(child, frame, inherited) for child in element.all("geom")]
    for child in element.all("frame"):
        inner = frame @ pose(child, settings, values)
        found += _geoms(child, child.attributes.get("childclass", inherited), inner, settings, values)
    return found


def _stated(element: Element, settings: Settings, values: Values) -> Inertia:
    mass = values.one(element, "mass")
    if mass < 0:
        values.faults.error(element.place_of("mass"), "the mass is negative")
    if "fullinertia" in element.attributes:
        xx, yy, zz, xy, xz, yz = values.numbers(element, "fullinertia", 6) or [number(0)] * 6
        tensor = vector_rows([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    else:
        xx, yy, zz = values.three(element, "diaginertia", "0 0 0")
        tensor = vector_rows([[xx, 0, 0], [0, yy, 0], [0, 0, zz]])
    return Inertia(mass, vector((0, 0, 0)), tensor).moved(pose(element, settings, values))


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
    return inertia(shape, size, mass).moved(frame @ place)


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
