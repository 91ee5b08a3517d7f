"""Offsets and sizes of the structs of the controller, equal for every compiler: reals first, then pairs of integers."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

from rrrgen.controller.table import ControllerUnit, Field, inputs, memory, outputs, parameters
from rrrgen.emit import Real

REAL_BYTES = {"double": 8, "float": 4}
HEAD = (
    Field("size", 1, "", "sizeof of this struct", integer=True, array=False, signed=False),
    Field(
        "abi", 1, "", "layout of all structs: type of numbers, modes and parts", integer=True, array=False, signed=False
    ),
)
"""What parameters begin with, followed by the 64-bit number ``model``: another one is refused."""

COUNTERS = (
    Field("magic", 1, "", "after a successful initialization", integer=True, array=False, signed=False),
    Field("sample", 1, "", "last sample counter", integer=True, array=False, signed=False),
    Field("phase", 1, "", "", integer=True, array=False),
    Field("mode", 1, "", "mode that acts", integer=True, array=False),
    Field("good", 1, "", "good samples in a row", integer=True, array=False),
    Field("bad", 1, "", "bad samples in a row", integer=True, array=False),
    Field("observing", 1, "", "the observer has a state", integer=True, array=False),
    Field("yielding", 1, "", "mode gravity after a contact", integer=True, array=False),
    Field("blending", 1, "", "the next torque starts from the last one", integer=True, array=False),
    Field("reserved", 1, "", "", integer=True, array=False),
)
"""The integers of the state."""


@dataclass(frozen=True)
class FieldOffset:
    """A field with its offset in the struct, in bytes."""

    field: Field
    offset: int


@dataclass(frozen=True)
class StructLayout:
    """A struct of C: ``places`` of its fields and its ``size`` in bytes."""

    name: str
    places: tuple[FieldOffset, ...]
    size: int


@dataclass(frozen=True)
class Structs:
    """All structs of a unit. ``memory`` is part of the state, ``derived`` are the reals that follow from parameters."""

    parameters: StructLayout
    input: StructLayout
    output: StructLayout
    memory: StructLayout
    derived: StructLayout
    state_size: int
    abi: int


def structs(unit: ControllerUnit, real: Real, proposed: dict[str, tuple[float, ...]]) -> Structs:
    """Lay out the structs of ``unit`` with numbers of the type ``real``."""
    width = REAL_BYTES[real]
    p = _struct("params", parameters(unit, proposed), width, 16)
    i, o = _struct("input", inputs(unit), width), _struct("output", outputs(unit), width)
    m, d = _struct("memory", memory(unit), width), _struct("derived", derived_fields(unit), width)
    state = _up(_up(p.size + m.size + d.size, 4) + 4 * len(COUNTERS), 8)
    text = repr([(s.name, [(q.field.name, q.field.count, q.offset) for q in s.places]) for s in (p, i, o, m, d)])
    abi = int(hashlib.sha256(f"{real} {unit.modes} {unit.parts} {text}".encode()).hexdigest()[:8], 16)
    return Structs(p, i, o, m, d, state, abi)


def derived_fields(unit: ControllerUnit) -> list[Field]:
    """The reals of the state that are computed from parameters when these are set."""
    fields = [
        Field("blend_left", 1, "", "share of the bump that a period leaves", array=False),
        Field("fade_left", 1, "", "share of the fading torque that a period leaves", array=False),
    ]
    if unit.has("differences"):
        fields.append(Field("speed_left", 1, "", "share of the last speed that a period leaves", array=False))
    if unit.has("observer"):
        fields.append(Field("decay", 1, "", "share of the estimated torques that a period leaves"))
    return [*fields, Field("beta_loaded", unit.model.beta_size, "SI", "base parameters with the payload")]


def _struct(name: str, fields: Sequence[Field], width: int, start: int = 0) -> StructLayout:
    """Place ``fields`` from ``start``; the struct is padded by a field ``reserved`` where its size needs it."""
    places, offset = [], start
    ordered = [field for field in fields if not field.integer] + [field for field in fields if field.integer]
    for field in ordered:
        places.append(FieldOffset(field, offset))
        offset += field.count * (4 if field.integer else width)
    multiple = 8 if start or width == 8 else 4
    if offset % multiple:  # only after integers, or after numbers of single precision before a 64-bit one
        missing = (multiple - offset % multiple) // 4
        places.append(FieldOffset(Field("reserved", missing, "", "not used", integer=True, array=missing > 1), offset))
        offset += 4 * missing
    return StructLayout(name, tuple(places), offset)


def _up(value: int, multiple: int) -> int:
    return -(-value // multiple) * multiple
