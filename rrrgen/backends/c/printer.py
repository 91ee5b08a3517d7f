"""Program -> the statements of a C function body.

Every node is visited once, in order. A value that is used once and has no name of its own is written into the
expression that uses it, as long as the line stays readable; everything else becomes a ``const`` local. The order and
association of the arithmetic is exactly the program's, so the emitted code rounds as the reference evaluation does.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from rrrgen.backends.c.dialect import Dialect
from rrrgen.backends.c.names import Names
from rrrgen.backends.c.trigonometry import LibmSinCos, SinCos
from rrrgen.program import Node, Op, Port, Program, Role

_LONGEST = 88  # characters of one expression; with the declaration in front a line stays below 120

_HALF = Fraction(1, 2)

# binding strength of printed text, weakest first
_CHOICE, _SUM, _PRODUCT, _UNARY, _ATOM = range(5)

_FUNCTIONS = {Op.SQRT: "sqrt", Op.ABS: "fabs", Op.EXP: "exp", Op.TANH: "tanh"}


@dataclass(frozen=True)
class Text:
    """A printed expression: its characters and how tightly they bind. ``quotient``: a division is at its top."""

    code: str
    strength: int = _ATOM
    quotient: bool = False

    def within(self, strength: int) -> str:
        """The characters, in parentheses unless they bind at least as tightly as ``strength``."""
        return self.code if self.strength >= strength else f"({self.code})"


def print_body(program: Program, dialect: Dialect, sincos: SinCos | None = None) -> list[str]:
    """The statements of ``program`` as lines without indentation; the last may be the return of the status."""
    return _Body(program, dialect, sincos or LibmSinCos()).lines


class _Body:
    def __init__(self, program: Program, dialect: Dialect, sincos: SinCos) -> None:
        self.program, self.dialect, self.sincos = program, dialect, sincos
        self.lines: list[str] = []
        self._texts: dict[int, Text] = {}
        self._names = Names([port.name for port in (*program.inputs, *program.outputs)])
        self._readers = _count_readers(program)
        self._places = _places_of_outputs(program)
        self._trigonometry = _trigonometry(program)
        self._angles = _joint_sums(program, set(self._trigonometry))
        self._discard_unused_inputs()
        for index in range(len(program.nodes)):
            self._visit(index)
        self._finish()

    # -- statements ----------------------------------------------------------------------------------------------

    def _discard_unused_inputs(self) -> None:
        read = {node.place[0] for node in self.program.nodes if node.op is Op.INPUT}
        self.lines += [f"(void){port.name};" for k, port in enumerate(self.program.inputs) if k not in read]

    def _declare(self, index: int, text: Text) -> Text:
        """Give the value of node ``index`` a local of its own."""
        hint = self.program.labels.get(index) or _named("q", self._angles.get(index))
        name = self._names.suggested(hint) if hint else self._names.temporary()
        self.lines.append(f"const {self.dialect.real_type} {name} = {text.code};")
        self._texts[index] = Text(name)
        return self._texts[index]

    def _visit(self, index: int) -> None:
        node = self.program.nodes[index]
        if node.op in (Op.SIN, Op.COS):
            self._declare_trigonometry(index)
        elif node.op is Op.INPUT:
            self._texts[index] = Text(element_of(*self._read(node)))
            return  # outputs that copy an input or a constant are written at the end, in order
        elif node.op is Op.CONST:
            self._texts[index] = Text(self.dialect.literal(node.number), _UNARY)
            return
        else:
            self._texts[index] = self._expression(index)
            if self._deserves_name(index):
                self._declare(index, self._texts[index])
        self._write_outputs(index)

    def _read(self, node: Node) -> tuple[Port, int]:
        """The input port and the element that an input node reads."""
        position, element = node.place
        return self.program.inputs[position], element

    def _deserves_name(self, index: int) -> bool:
        readers = self._readers[index]
        return readers > 1 or (readers == 1 and (index in self._places or index in self.program.labels))

    def _write_outputs(self, index: int) -> None:
        """Store a value where it is wanted as soon as it is known, which keeps few values alive at a time."""
        first = ""
        for port, element in self._places.pop(index, ()):
            target = element_of(port, element, output=True)
            self.lines.append(f"{target} = {first or self._texts[index].code};")
            first = first or target

    def _finish(self) -> None:
        for k, (port, elements) in enumerate(zip(self.program.outputs, self.program.results, strict=True)):
            for element, index in enumerate(elements):
                if index in self._places and not self.program.is_status(k):
                    self.lines.append(f"{element_of(port, element, output=True)} = {self._texts[index].code};")
        if (status := self.program.status) is not None:
            (index,), half = self.program.results[status.output], self.dialect.literal(_HALF)
            condition = f"{self._texts[index].within(_SUM)} < {half}"  # a NaN must not read as OK
            self.lines.append(f"return ({condition}) ? {self.dialect.success} : {self.dialect.failure(status)};")

    def _declare_trigonometry(self, index: int) -> None:
        if index in self._texts:
            return  # declared together with its twin
        angle = self.program.nodes[index].args[0]
        names: dict[Op, str] = {}
        for op, twin in self._trigonometry[angle].items():
            names[op] = self._names.suggested(self.program.labels.get(twin) or self._trigonometric_name(op, angle))
            self._texts[twin] = Text(names[op])
        argument = self._texts[angle].code
        self.lines += self.sincos.statements(self.dialect, argument, names.get(Op.SIN), names.get(Op.COS))

    def _trigonometric_name(self, op: Op, angle: int) -> str:
        """s2 for sin(q2), c23 for cos(q2 + q3), else a name after the angle's own."""
        letter = "s" if op is Op.SIN else "c"
        code = self._texts[angle].code
        named = _named(letter, self._angles.get(angle))
        return named or (f"{letter}_{code}" if code.isidentifier() else f"{letter}_angle")

    # -- expressions ---------------------------------------------------------------------------------------------

    def _expression(self, index: int) -> Text:
        """Print node ``index``, moving the longest operands into locals until the line is short enough."""
        args = self.program.nodes[index].args
        if self.program.nodes[index].op is Op.SIGN:  # the operand is written three times
            self._settle(args[0])
        while True:
            text = self._compose(index)
            if len(text.code) <= _LONGEST:
                return text
            longest = max(args, key=lambda arg: len(self._texts[arg].code))
            if not self._settle(longest):
                return text

    def _settle(self, index: int) -> bool:
        """Move an operand into a local; False if it is an atom already."""
        text = self._texts[index]
        if (text.strength == _ATOM and "(" not in text.code) or self.program.nodes[index].op is Op.CONST:
            return False
        self._declare(index, text)
        return True

    def _compose(self, index: int) -> Text:
        node = self.program.nodes[index]
        args = [self._texts[arg] for arg in node.args]
        match node.op:
            case Op.ADD:
                left, right = args
                if right.strength == _SUM and left.strength > _SUM:
                    left, right = right, left  # (a + b) + c needs no parentheses
                return Text(f"{left.within(_SUM)} + {right.within(_PRODUCT)}", _SUM)
            case Op.SUB:
                return Text(f"{args[0].within(_SUM)} - {args[1].within(_PRODUCT)}", _SUM)
            case Op.MUL:
                return self._product(node.args, args)
            case Op.DIV:
                return Text(f"{args[0].within(_PRODUCT)}/{args[1].within(_UNARY)}", _PRODUCT, quotient=True)
            case Op.NEG:
                return Text(f"-{args[0].within(_PRODUCT)}", _SUM)  # in parentheses wherever it is an operand
            case Op.SIGN:
                return Text(self.dialect.sign(args[0].code), _CHOICE)
            case Op.SELECT:
                texts = args[0].within(_PRODUCT), args[1].within(_SUM), args[2].within(_SUM)
                return Text(self.dialect.select(*texts), _CHOICE)
            case _:
                return Text(f"{self.dialect.function(_FUNCTIONS[node.op])}({args[0].code})")

    def _product(self, indices: tuple[int, ...], args: list[Text]) -> Text:
        left, right = args
        constant_first = self.program.nodes[indices[0]].op is Op.CONST
        if right.strength == _PRODUCT and left.strength > _PRODUCT and not right.quotient and not constant_first:
            left, right = right, left  # (a*b)*c needs no parentheses
        first = left.within(_UNARY) if left.quotient else left.within(_PRODUCT)
        return Text(f"{first}*{right.within(_UNARY)}", _PRODUCT)


def element_of(port: Port, element: int, output: bool = False) -> str:
    """``q[1]``; the bare name of a scalar input, ``*name`` of a scalar output."""
    if port.shape == ():
        return f"*{port.name}" if output else port.name
    return f"{port.name}[{element}]"


def _count_readers(program: Program) -> list[int]:
    """How often each node is an operand."""
    readers = [0] * len(program.nodes)
    for node in program.nodes:
        for arg in node.args:
            readers[arg] += 1
    return readers


def _places_of_outputs(program: Program) -> dict[int, list[tuple[Port, int]]]:
    """Where each node is stored; the status is returned, not stored."""
    places: dict[int, list[tuple[Port, int]]] = {}
    for k, (port, elements) in enumerate(zip(program.outputs, program.results, strict=True)):
        for element, index in enumerate(elements):
            if not program.is_status(k):
                places.setdefault(index, []).append((port, element))
    return places


def _trigonometry(program: Program) -> dict[int, dict[Op, int]]:
    """Angle node -> its sine and cosine nodes."""
    found: dict[int, dict[Op, int]] = {}
    for index, node in enumerate(program.nodes):
        if node.op in (Op.SIN, Op.COS):
            found.setdefault(node.args[0], {})[node.op] = index
    return {angle: dict(sorted(twins.items(), key=lambda item: item[0] is Op.COS)) for angle, twins in found.items()}


def _joint_sums(program: Program, angles: set[int]) -> dict[int, tuple[int, ...]]:
    """Joint numbers (from 1) of the angles that are a joint variable or a sum of some."""
    sums: dict[int, tuple[int, ...]] = {}
    for index, node in enumerate(program.nodes):
        if node.op is Op.INPUT and program.inputs[node.place[0]].role is Role.POSITION:
            sums[index] = (node.place[1] + 1,)
        elif node.op is Op.ADD and node.args[0] in sums and node.args[1] in sums:
            sums[index] = tuple(sorted(sums[node.args[0]] + sums[node.args[1]]))
    return {index: joints for index, joints in sums.items() if index in angles}


def _named(letter: str, joints: tuple[int, ...] | None) -> str:
    return letter + "".join(map(str, joints)) if joints else ""
