"""Writer of robot files: YAML text that loads back to an equal description, in the units of the original file."""

from __future__ import annotations

import re
from dataclasses import fields, replace

import sympy as sp

from rrrgen.base.yamltext.fields import Key
from rrrgen.base.yamltext.units import ANGLE, LENGTH, NUMBER, QUANTITIES, UNITS, FileUnits, Quantity, Unit
from rrrgen.robot.file.fields import BASE, DRIVE, FIT, FRICTION, HASH_DIGITS, LIMITS, LINEAR_FRICTION, MOTOR
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.spec import (
    BasisSpec,
    DriveSpec,
    DrivesSpec,
    FitSpec,
    FixedTransform,
    FrictionSpec,
    JointSpec,
    Limits,
    LinkSpec,
    MotorSpec,
    RobotSpec,
    TipSpec,
)

_CERTAIN = 5  # rad, m or mm: bare numbers on the wrong side of it look like another unit, so the unit is written

_HASHES = 8  # on a line

_SMALL = 1e-3  # rad; smaller angles, such as encoder steps, are printed in radians


def dumps(spec: RobotSpec) -> str:
    """Write ``spec`` as YAML text, exactly: loading it gives an equal spec."""
    printer = _Printer(spec)
    lines = ["schema: rrrgen/1", f"name: {spec.name}"]
    lines += [f"{key}: {quote(text)}" for key in ("description", "source") if (text := getattr(spec, key))]
    lines.append(f"convention: {spec.convention}")
    lines.append(f"units: {{angle: {spec.angle_unit}, length: {spec.length_unit}}}")
    lines.append(f"gravity: [{', '.join(number_text(value) for value in spec.gravity)}]")
    if spec.parameters:
        lines.append("parameters:")
        lines += [f"  {name}: {printer.parameter(name, value)}" for name, value in spec.parameters.items()]
    lines += printer.transform("base", spec.base)
    if spec.floating_base and spec.links is not None:
        lines += [
            "floating_base:",
            f"  name: {spec.rows[0].name}",
            *(f"  {line}" for line in printer.body(spec.links[0])),
        ]
    lines.append("joints:")
    for i in range(spec.floating_base, len(spec.rows)):
        lines += printer.joint(*_row(spec, i))
    if spec.mechanism is not None:
        lines.append(f"tip: {spec.rows[spec.mechanism.tip].name}")
    lines += printer.loops(spec)
    lines += printer.transform("tool", spec.tool)
    lines += printer.tools(spec.tools)
    lines += printer.tips(spec.tips)
    if spec.links is not None:
        lines.append("links:")
        for link in spec.links[spec.floating_base :]:
            lines += printer.link(link)
    if spec.drives is not None:
        lines += printer.drives(spec.drives)
    if spec.basis is not None:
        lines += _basis(spec.basis)
    if spec.emit:
        lines.append(f"emit: [{', '.join(spec.emit)}]")
    if spec.ik != "general":
        lines.append(f"ik: {spec.ik}")
    if spec.provenance:
        lines.append("provenance:")
        for fit in spec.provenance:
            lines += _fit(fit)
    return "\n".join(lines) + "\n"


def quote(text: str) -> str:
    """Write ``text`` as a double-quoted YAML scalar on one line."""

    def escape(match: re.Match[str]) -> str:
        code = ord(match.group())
        return "\\" + match.group() if match.group() in '"\\' else f"\\u{code:04x}"

    return '"' + re.sub('["\\\\\x00-\x1f\x7f-\x9f\u2028\u2029\ufeff\ufffe\uffff]', escape, text) + '"'


def number_text(value: sp.Expr) -> str:
    """Print an exact number or expression as robot files write it (:mod:`rrrgen.base.yamltext.expressions`)."""
    value = sp.sympify(value, strict=True)
    value = value.xreplace({item: sp.Rational(repr(float(item))) for item in value.atoms(sp.Float)})
    if not value.is_Rational:
        return str(sp.sstr(value))
    twos, fives, rest = 0, 0, int(value.q)
    while rest % 2 == 0:
        twos, rest = twos + 1, rest // 2
    while rest % 5 == 0:
        fives, rest = fives + 1, rest // 5
    digits = max(twos, fives)
    if rest != 1 or digits > 60:
        return f"{value.p}/{value.q}"
    text = str(abs(int(value.p)) * 10**digits // int(value.q)).rjust(digits + 1, "0")
    decimal = f"{text[:-digits]}.{text[-digits:]}" if digits else text
    return f"-{decimal}" if value < 0 else decimal


def _with_unit(value: sp.Expr, unit: str) -> str:
    text = number_text(value)
    return f"{text} {unit}" if re.fullmatch(r"-?[\d.]+", text) else f"({text}) {unit}"


class _Printer:
    """Prints values in the units of one file."""

    def __init__(self, spec: RobotSpec) -> None:
        self.units = FileUnits(spec.angle_unit, spec.length_unit)
        self.parameter_units = spec.parameter_units

    def parameter(self, name: str, value: sp.Expr) -> str:
        unit = self.parameter_units.get(name)
        return _with_unit(value / UNITS[unit].si(), unit) if unit else number_text(value)

    def value(self, value: sp.Expr, quantity: str) -> str:
        """One geometric value: bare in the units of the file if that is unambiguous, otherwise with a unit."""
        target = QUANTITIES[quantity]
        unit = self.units.of(target)
        value = sp.sympify(value, strict=True)
        if value.free_symbols:
            return number_text(value / unit.si() if self._is_plain(value) else value)
        inside = value / unit.si()
        if unit.name in ("rad", "m"):
            certain = not inside.is_Rational or abs(inside) <= _CERTAIN
        else:
            certain = inside.is_Rational and (inside == 0 or abs(inside) >= _CERTAIN)
        if certain:
            return number_text(inside)
        return _with_unit(inside, unit.name) if inside.is_Rational else _with_unit(value, target.si_unit)

    def _is_plain(self, value: sp.Expr) -> bool:
        """Whether all parameters in ``value`` are plain numbers, so that the unit of the file applies to it."""
        units = [self.parameter_units.get(str(symbol)) for symbol in value.free_symbols]
        return all(unit is not None and UNITS[unit].dimension == NUMBER for unit in units)

    def number(self, value: float, quantity: str, file_units: bool) -> str:
        """Print a float such that exactly the same float is read back."""
        target = QUANTITIES[quantity]
        unit = self.units.of(target) if file_units else FileUnits().of(target)
        return _float_text(value, target, unit)

    def joint(self, joint: JointSpec, parent: str, follows: dict[str, sp.Expr] | None) -> list[str]:
        lines = [f"  - name: {joint.name}", f"    type: {joint.type}"]
        for name, quantity in (("alpha", "angle"), ("a", "length"), ("d", "length"), ("theta", "angle")):
            lines.append(f"    {name}: {self.value(getattr(joint, name), quantity)}")
        for name, quantity in (("gamma", "angle"), ("b", "length")):
            if (value := getattr(joint, name)) != 0:
                lines.append(f"    {name}: {self.value(value, quantity)}")
        if joint.sign < 0:
            lines.append("    sign: -1")
        if parent:
            lines.append(f"    parent: {parent}")
        if follows is not None:
            terms = ", ".join(f"{name}: {number_text(factor)}" for name, factor in follows.items())
            lines.append(f"    follows: {{{terms}}}")
        if joint.limits != Limits():
            lines.append(f"    limits: {self.section(joint.limits, LIMITS, joint.type)}")
        if joint.friction is not None:
            lines.append(f"    friction: {self.friction(joint.friction, joint.type)}")
        if joint.drive is not None:
            lines.append(f"    drive: {self.section(joint.drive, DRIVE, joint.type)}")
        return lines

    def friction(self, friction: FrictionSpec, joint_type: str) -> str:
        if friction.law is None:
            return self.section(friction, LINEAR_FRICTION, joint_type)
        keys = {key.name: key for key in FRICTION}
        named = dict(zip((p.name for p in LAWS[friction.law.name].parameters), friction.law.values, strict=True))
        named |= {} if friction.offset is None else {"offset": friction.offset}
        entries = [
            f"{key}: {self.number(value, keys[key].quantity_for(joint_type), False)}" for key, value in named.items()
        ]
        return "{" + ", ".join([f"law: {friction.law.name}", *entries]) + "}"

    def section(self, values: Limits | FrictionSpec | DriveSpec, table: tuple[Key, ...], joint_type: str) -> str:
        keys = {key.name: key for key in table}
        entries = []
        for item in fields(values):
            value = getattr(values, item.name)
            if value is not None and item.name in keys:
                key = keys[item.name]
                text = self.number(float(value), key.quantity_for(joint_type), key.file_units)
                entries.append(f"{item.name}: {text}")
        return "{" + ", ".join(entries) + "}"

    def link(self, link: LinkSpec) -> list[str]:
        return [("    " if i else "  - ") + line for i, line in enumerate(self.body(link))]

    def body(self, link: LinkSpec) -> list[str]:
        sign = -1 if link.products == "positive" else 1
        entries = dict(zip(("xx", "yy", "zz", "xy", "xz", "yz"), link.inertia, strict=True))
        texts = [f"about: {link.about}", f"products: {link.products}"]
        texts += [f"{name}: {number_text(entries[name])}" for name in ("xx", "yy", "zz")]
        texts += [f"{name}: {number_text(sign * entries[name])}" for name in ("xy", "xz", "yz") if entries[name]]
        com = ", ".join(self.value(value, "length") for value in link.com)
        return [f"mass: {number_text(link.mass)}", f"com: [{com}]", f"inertia: {{{', '.join(texts)}}}"]

    def drives(self, drives: DrivesSpec) -> list[str]:
        lines = ["drives:", "  joint_from_drive:"]
        lines += [f"    - [{', '.join(number_text(value) for value in row)}]" for row in drives.joint_from_drive]
        lines.append("  motors:")
        for motor in drives.motors:
            lines += self.motor(motor)
        return lines

    def motor(self, motor: MotorSpec) -> list[str]:
        keys = {key.name: key for key in MOTOR}
        lines = [f"    - name: {motor.name}"]
        if motor.type != "revolute":
            lines.append(f"      type: {motor.type}")
        if motor.gear_ratio != 1:
            lines.append(f"      gear_ratio: {number_text(motor.gear_ratio)}")
        for name in ("inertia", "torque_limit"):
            value = getattr(motor, name)
            if value is not None:
                lines.append(f"      {name}: {self.number(value, keys[name].quantity_for(motor.type), False)}")
        if motor.friction is not None:
            lines.append(f"      friction: {self.friction(motor.friction, motor.type)}")
        return lines

    def tools(self, tools: dict[str, FixedTransform]) -> list[str]:
        lines = ["tools:"] if tools else []
        for name, transform in tools.items():
            entries = self.transform(name, transform) or [f"{name}: {{}}"]
            lines += [f"  {line}" for line in entries]
        return lines

    def tips(self, tips: dict[str, TipSpec]) -> list[str]:
        lines = ["tips:"] if tips else []
        for name, tip in tips.items():
            entries = [f"{name}:", f"  row: {tip.row}", *(f"  {line}" for line in self.transform("tool", tip.tool))]
            lines += [f"  {line}" for line in entries]
        return lines

    def loops(self, spec: RobotSpec) -> list[str]:
        """The section ``loops``; no lines for a robot without closed loops."""
        lines = ["loops:"] if spec.loops else []
        for loop in spec.loops:
            first, second = (spec.rows[row].name for row in loop.passive)
            places = [", ".join(self.value(v, "length") for v in place) for _, place in loop.pins]
            ends = [BASE if row < 0 else spec.rows[row].name for row, _ in loop.pins]
            pins = ", ".join(f"{end}: [{place}]" for end, place in zip(ends, places, strict=True))
            lines += [f"  {loop.name}:", f"    passive: [{first}, {second}]", f"    pins: {{{pins}}}"]
            if loop.start is None:
                lines.append(f"    assembly: {loop.assembly:+d}")
                continue
            rows = [spec.rows[row] for row in loop.passive]
            kinds = ["angle" if row.is_revolute else "length" for row in rows]
            at = [f"{row.name}: {self.value(v, kind)}" for row, v, kind in zip(rows, loop.start, kinds, strict=True)]
            lines += ["    solve: newton", f"    start: {{{', '.join(at)}}}"]
        return lines

    def transform(self, name: str, transform: FixedTransform) -> list[str]:
        if transform == FixedTransform():
            return []
        translation = ", ".join(self.value(value, "length") for value in transform.translation)
        lines = [f"{name}:", f"  translation: [{translation}]"]
        if transform.rotation != FixedTransform().rotation:
            lines.append("  rotation:")
            for i in range(3):
                row = ", ".join(number_text(value) for value in transform.rotation[3 * i : 3 * i + 3])
                lines.append(f"    - [{row}]")
        return lines


def _row(spec: RobotSpec, i: int) -> tuple[JointSpec, str, dict[str, sp.Expr] | None]:
    """Row ``i`` with the parent and the followed joints that the file must state; "" and None for the default."""
    row, mechanism = spec.rows[i], spec.mechanism
    if mechanism is None:
        return row, "", None
    counted = {joint.name: joint for joint in spec.joints}
    coordinates = (*counted, *(spec.rows[row].name for row in mechanism.passive))
    before = mechanism.parents[i]
    first = int(spec.floating_base)  # the row before it is the body of a floating base
    parent = "" if before == i - 1 else BASE if before < first else mechanism.rows[before].name
    follows = {name: factor for name, factor in zip(coordinates, mechanism.matrix[i], strict=True) if factor != 0}
    if i in mechanism.passive:
        return replace(row, sign=int(follows[row.name])), parent, None
    return counted.get(row.name, row), parent, None if follows == {row.name: 1} else follows


def _float_text(value: float, target: Quantity, unit: Unit) -> str:
    """Print ``value`` (SI) as text that reads back as exactly the same float.

    It is in degrees or in the unit of the file if few decimals suffice. Otherwise it has all digits of the float, with
    the SI unit where a number without a unit would be in another unit or ambiguous.
    """
    plain = repr(value).removesuffix(".0")
    candidates = [UNITS["deg"]] if target.dimension == ANGLE else []
    for other in candidates + ([unit] if unit.name != target.si_unit else []):
        for digits in (0, 3, 6, 9, 12):
            text = repr(round(value / float(other.si()), digits)).removesuffix(".0")
            if value and abs(value) > _SMALL and float(sp.Rational(text) * other.si()) == value:
                return f"{text} {other.name}"
    doubtful = abs(value) > _CERTAIN and target.dimension in (ANGLE, LENGTH)
    return plain if unit.name == target.si_unit and not doubtful else f"{plain} {target.si_unit}"


def _basis(basis: BasisSpec) -> list[str]:
    pairs = zip(basis.names, basis.expressions, strict=True)
    lines = ["basis:", f"  products: {basis.products}", "  parameters:"]
    return lines + [f"    - {name} = {number_text(expression)}" for name, expression in pairs]


def _fit(fit: FitSpec) -> list[str]:
    method = next(key.choices[0] for key in FIT if key.name == "method")
    words = [f"{word:0{HASH_DIGITS}x}" for word in fit.hashes]
    texts = [f"{name}: {quote(text)}" for name in ("program", "recordings", "data") if (text := getattr(fit, name))]
    lines = [*texts, f"method: {method}", f"windows: {fit.windows}", "fingerprint:"]
    lines += [f'  - "{"".join(words[i : i + _HASHES])}"' for i in range(0, len(words), _HASHES)]
    return [f"  - {lines[0]}", *(f"    {line}" for line in lines[1:])]
