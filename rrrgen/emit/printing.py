"""Printing of a program as statements of a language with infix arithmetic.

Every node is visited once, in order. A value that is used once and has no name of its own is written into the
expression that uses it, as long as the line stays readable; everything else becomes a local. The order and association
of the arithmetic is exactly the program's (operands of a sum or product may change sides, which no rounding sees), so
the emitted code rounds as the reference evaluation does.
"""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from itertools import chain

from rrrgen.base.errors import BackendError
from rrrgen.emit import Real
from rrrgen.emit.interface import ATOM, PRODUCT, SUM, UNARY, FunctionTarget, Target, Text
from rrrgen.program import REFUSED, Op, Port, Program, Role

# ------------------------------------------------------------------------------------------------------------------
# Text for comments in emitted files: escaped, wrapped, aligned in columns.
# ------------------------------------------------------------------------------------------------------------------

WIDTH = 112


def plain(text: str) -> str:
    """Make ``text`` safe for a comment: on one line, without comment marks, line continuations and trigraphs."""
    flat = " ".join(text.split())
    printable = "".join(c if c.isprintable() else "?" for c in flat)
    return printable.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?").rstrip("\\")


def port_text(port: Port, shape: str = "") -> str:
    """What a port is, its unit, its frame and its ``shape``, as far as they are stated: "joint positions, rad, [3]"."""
    return ", ".join(plain(part) for part in (port.meaning, port.unit, port.frame, shape) if part)


def mathematics(expression: object) -> str:
    """Print an expression for a comment, with ^ for powers, since ** is no operator of C or Rust."""
    return plain(str(expression).replace("**", "^"))


def wrap(text: str) -> list[str]:
    """Break ``text`` into lines of a comment."""
    return textwrap.wrap(plain(text), WIDTH, break_long_words=False)


def columns(rows: Iterable[Sequence[str]], indent: str = "  ", gap: str = "  ") -> list[str]:
    """Format ``rows`` as lines of left-aligned columns without trailing blanks; a long last column is wrapped."""
    table = [[plain(cell) for cell in row] for row in rows]
    if not table:
        return []
    widths = [max(len(row[k]) for row in table) for k in range(len(table[0]))]
    lines = []
    for row in table:
        head = indent + "".join(cell.ljust(width) + gap for cell, width in zip(row[:-1], widths, strict=False))
        last = textwrap.wrap(row[-1], max(30, WIDTH - len(head)), break_long_words=False) or [""]
        lines += [(head + last[0]).rstrip(), *(" " * len(head) + more for more in last[1:])]
    return lines


# ------------------------------------------------------------------------------------------------------------------
# Names of local variables: readable, unique within their function, and not reserved by the language.
# ------------------------------------------------------------------------------------------------------------------


class Names:
    """Generates the local names of one function, different from those in ``reserved`` and ``taken``."""

    def __init__(self, reserved: frozenset[str], taken: Iterable[str] = ()) -> None:
        self._taken = {*reserved, *taken}
        self._temporaries = 0
        self._serials: dict[str, int] = {}

    def temporary(self) -> str:
        """The next unused name of the sequence t1, t2, ..."""
        while True:
            self._temporaries += 1
            name = f"t{self._temporaries}"
            if name not in self._taken:
                self._taken.add(name)
                return name

    def from_hint(self, hint: str) -> str:
        """The name ``hint``, made a valid identifier; a number is appended if it is taken."""
        base = re.sub(r"\W+", "_", hint, flags=re.ASCII).strip("_") or "t"
        if base[0].isdigit():
            base = f"t{base}"
        name = base
        while name in self._taken:
            self._serials[base] = self._serials.get(base, 1) + 1
            name = f"{base}_{self._serials[base]}"
        self._taken.add(name)
        return name


def with_free_ports(program: Program, taken: frozenset[str]) -> Program:
    """The program with an underscore behind those names of inputs and outputs that are in ``taken``.

    For languages in which a variable must not have the name of a keyword, or of a constant of the emitted file.
    """

    def rename(port: Port) -> Port:
        return replace(port, name=f"{port.name}_") if port.name in taken else port

    return replace(program, inputs=tuple(map(rename, program.inputs)), outputs=tuple(map(rename, program.outputs)))


# ------------------------------------------------------------------------------------------------------------------
# Printing of a program as statements of a language with infix arithmetic
# ------------------------------------------------------------------------------------------------------------------

_UNKNOWN = Text("")
_LONGEST = 88  # characters of one expression; with the declaration in front a line stays below 120


def print_body(program: Program, target: FunctionTarget) -> list[str]:
    """The statements of a function as lines without indentation; the last ones report the status, if there is any."""
    return FunctionBody(program, target).lines


class Statements:
    """Prints the definitions of a program as statements in ``lines``, and keeps the text of every node.

    ``read(port, element)`` returns the text of an element of an input port, both numbered from 0.
    """

    def __init__(self, program: Program, target: Target, names: Names, read: Callable[[int, int], str]) -> None:
        self.program, self.target, self.names = program, target, names
        self.lines: list[str] = []
        self.texts = [_UNKNOWN] * len(program.nodes)
        self._read, self._labels = read, program.labels
        self._readers = _count(chain.from_iterable(node.args for node in program.nodes), len(program.nodes))
        self._wanted = _count(chain.from_iterable(program.results), len(program.nodes))
        self._named: list[bool] = []
        self._trigonometry = _trigonometry(program)
        self._angles = _joint_sums(program, set(self._trigonometry))

    def write(self) -> None:
        """Print the definitions of all nodes in the order of the program."""
        self._named = self._worth_a_name()
        for index in range(len(self.program.nodes)):
            self._visit(index)

    # -- statements ----------------------------------------------------------------------------------------------

    def _declare(self, index: int, text: Text) -> Text:
        """Give the value of node ``index`` a local of its own."""
        hint = self._labels.get(index) or (_joint_name("q", self._angles[index]) if index in self._angles else "")
        name = self.names.from_hint(hint) if hint else self.names.temporary()
        self.lines.append(self.target.declaration(name, text.code))
        self.texts[index] = Text(name)
        return self.texts[index]

    def _visit(self, index: int) -> None:
        op, args, _ = node = self.program.nodes[index]
        if op is Op.INPUT:
            self.texts[index] = Text(self._read(*node.place))
            return
        if op is Op.CONST:
            code = self.target.literal(node.number)
            self.texts[index] = Text(code, SUM if code.startswith("-") else UNARY)
            return
        if op is Op.SIN or op is Op.COS:
            self._declare_trigonometry(index)
        else:
            self.texts[index] = self._expression(op, args)
            if self._named[index]:
                self._declare(index, self.texts[index])
        self._finish_node(index)

    def _worth_a_name(self) -> list[bool]:
        """For every node, whether its value gets a local variable: if it is read more than once or has a label."""
        labels = self.program.labels
        return [
            readers + wanted > 1 or (readers == 1 and index in labels)
            for index, (readers, wanted) in enumerate(zip(self._readers, self._wanted, strict=True))
        ]

    def _finish_node(self, index: int) -> None:
        """Called when node ``index`` has been given its text; does nothing here, subclasses write outputs."""

    def _declare_trigonometry(self, index: int) -> None:
        if self.texts[index] is not _UNKNOWN:
            return  # declared together with the other of the pair
        angle = self.program.nodes[index].args[0]
        names: dict[Op, str] = {}
        for op, node in self._trigonometry[angle].items():
            names[op] = self.names.from_hint(self.program.labels.get(node) or self._trigonometric_name(op, angle))
            self.texts[node] = Text(names[op])
        self.lines += self.target.sincos(self.texts[angle].code, names.get(Op.SIN), names.get(Op.COS))

    def _trigonometric_name(self, op: Op, angle: int) -> str:
        """The name of a sine or cosine: s2 for sin(q2), c23 for cos(q2 + q3), otherwise made from the angle's name."""
        letter = "s" if op is Op.SIN else "c"
        code = self.texts[angle].code
        named = _joint_name(letter, self._angles.get(angle))
        return named or (f"{letter}_{code}" if code.isidentifier() else f"{letter}_angle")

    # -- expressions ---------------------------------------------------------------------------------------------

    def _expression(self, op: Op, args: tuple[int, ...]) -> Text:
        """Print an operation, moving the longest operands into locals until the line is short enough."""
        if op is Op.SIGN or op is Op.MIN:  # some languages write the operands several times
            for arg in args:
                self._settle(arg)
        while True:
            text = self._compose(op, args)
            if len(text.code) <= _LONGEST:
                return text
            longest = max(args, key=lambda arg: len(self.texts[arg].code))
            if not self._settle(longest):
                return text

    def _settle(self, index: int) -> bool:
        """Give an operand a local variable; returns False, and does nothing, if its text is a single name or number."""
        text = self.texts[index]
        if (text.strength == ATOM and "(" not in text.code) or self.program.nodes[index].op is Op.CONST:
            return False
        self._declare(index, text)
        return True

    def _compose(self, op: Op, args: tuple[int, ...]) -> Text:
        texts = self.texts
        if op is Op.MUL:
            return self._product(args)
        if op is Op.ADD:
            left, right = texts[args[0]], texts[args[1]]
            if right.strength == SUM and left.strength > SUM:
                left, right = right, left  # (a + b) + c needs no parentheses
            return Text(f"{self._first_term(left)} + {right.within(self._term)}", SUM)
        if op is Op.SUB:
            return Text(f"{self._first_term(texts[args[0]])} - {texts[args[1]].within(self._term)}", SUM)
        if op is Op.NEG:
            return Text(f"-{texts[args[0]].within(self._term)}", SUM)  # in parentheses wherever it is an operand
        if op is Op.DIV:
            return Text(f"{texts[args[0]].within(PRODUCT)}/{texts[args[1]].within(UNARY)}", PRODUCT, quotient=True)
        if op is Op.SIGN:
            return self.target.sign(texts[args[0]])
        if op is Op.MIN:
            return self.target.minimum(texts[args[0]], texts[args[1]])
        if op is Op.SELECT:
            return self.target.select(*(texts[arg] for arg in args))
        return Text(self.target.call(op, texts[args[0]].code))

    @property
    def _term(self) -> int:
        """How tightly a term of a sum must bind to stand without parentheses."""
        return UNARY if self.target.explicit else PRODUCT

    def _first_term(self, text: Text) -> str:
        return text.within(self._term) if text.strength == PRODUCT else text.within(SUM)

    def _product(self, args: tuple[int, ...]) -> Text:
        left, right = self.texts[args[0]], self.texts[args[1]]
        constant_first = self.program.nodes[args[0]].op is Op.CONST
        if right.strength == PRODUCT and left.strength > PRODUCT and not right.quotient and not constant_first:
            left, right = right, left  # (a*b)*c needs no parentheses
        first = left.within(UNARY) if left.quotient else left.within(PRODUCT)
        return Text(f"{first}*{right.within(UNARY)}", PRODUCT)


class FunctionBody(Statements):
    """A whole function: outputs are written as soon as they are known, which keeps few values alive at a time.

    Locals get no name that is ``taken``.
    """

    def __init__(self, program: Program, target: FunctionTarget, taken: Iterable[str] = ()) -> None:
        ports = (*program.inputs, *program.outputs)
        names = Names(target.reserved, [*(port.name for port in ports), *taken])
        super().__init__(program, target, names, lambda port, k: target.element(program.inputs[port], k))
        self._function = target
        self._places = _places_of_outputs(program)
        self._committed = _guarded_results(program)
        read = {node.place[0] for node in program.nodes if node.op is Op.INPUT}
        self.lines += [target.discard(port) for k, port in enumerate(program.inputs) if k not in read]
        self.write()
        self._finish()
        self._report()

    def _worth_a_name(self) -> list[bool]:
        """For every node, whether it gets a local variable; one that only outputs use is written to the first one."""
        labels, places = self.program.labels, self._places
        return [
            readers > 1 or (readers == 1 and (index in places or index in labels))
            for index, readers in enumerate(self._readers)
        ]

    def _finish_node(self, index: int) -> None:
        if index in self._committed:
            return  # all of them in one branch at the end
        first = ""
        for port, element in self._places.pop(index, ()):
            place = self._function.element(port, element, output=True)
            self.lines.append(f"{place} = {first or self.texts[index].code};")
            first = first or place

    def _commit(self) -> None:
        """Print the results of a guarded function, all selected by one condition, as one branch."""
        texts, branches = self.texts, dict[int, list[str]]()
        for operand in (1, 2):
            branches[operand] = [
                f"{self._function.element(port, element, output=True)} = {texts[self._operand(index, operand)].code};"
                for index in self._committed
                for port, element in self._places[index]
            ]
        for index in self._committed:
            del self._places[index]
        self.lines += self._function.branch(texts[self._operand(self._committed[0], 0)], branches[1], branches[2])

    def _operand(self, index: int, number: int) -> int:
        return self.program.nodes[index].args[number]

    def _finish(self) -> None:
        """Print the outputs that only copy an input or a constant, in order."""
        if self._committed:
            self._commit()
        for k, (port, elements) in enumerate(zip(self.program.outputs, self.program.results, strict=True)):
            for element, index in enumerate(elements):
                if index in self._places and not self.program.is_status(k):
                    place = self._function.element(port, element, output=True)
                    self.lines.append(f"{place} = {self.texts[index].code};")

    def _report(self) -> None:
        """Print the status, if there is any."""
        if (status := self.program.status) is not None:
            (index,) = self.program.results[status.output]
            self.lines += self._function.outcome(status, self.texts[index])


_SMALLEST_FLOAT, _LARGEST_FLOAT = Fraction(2) ** -126, Fraction(2) ** 127  # normalised numbers of single precision


@lru_cache(maxsize=4096)  # the same lengths and weights occur in most functions
def nested_element(port: Port, element: int) -> str:
    """Element number ``element``, row-major, of a port that is an array of arrays, such as ``M[1][2]``."""
    indices: list[int] = []
    for size in reversed(port.shape):
        element, index = divmod(element, size)
        indices.insert(0, index)
    return port.name + "".join(f"[{index}]" for index in indices)


def decimal(value: Fraction | int, real: Real = "double") -> str:
    """Print a constant as a decimal literal that reads back to the nearest double; exact where 17 digits suffice.

    Raises BackendError for a constant that does not fit a number of type ``real``.
    """
    if real == "float" and value and not _SMALLEST_FLOAT <= abs(Fraction(value)) <= _LARGEST_FLOAT:
        raise BackendError(f"a constant of the model does not fit a float: {float(value):.3g}")
    try:
        number = float(value)
    except OverflowError:
        number = float("inf")
    if abs(number) == float("inf") or (number == 0.0 and value != 0):
        raise BackendError(f"a constant of the model does not fit a double: {value}")
    text = repr(number) if Fraction(repr(number)) == value else f"{number:.17g}"
    return text if any(mark in text for mark in ".e") else f"{text}.0"


def _count(indices: Iterable[int], size: int) -> list[int]:
    """Count how often each number in 0 .. size - 1 occurs in ``indices``."""
    tally = Counter(indices)
    return [tally[index] for index in range(size)]


def _places_of_outputs(program: Program) -> dict[int, list[tuple[Port, int]]]:
    """The output elements that each node is stored in; the status is returned, not stored."""
    places: dict[int, list[tuple[Port, int]]] = {}
    for k, (port, elements) in enumerate(zip(program.outputs, program.results, strict=True)):
        for element, index in enumerate(elements):
            if not program.is_status(k):
                places.setdefault(index, []).append((port, element))
    return places


def _guarded_results(program: Program) -> list[int]:
    """The results of a guarded function, which are selected by the condition that its input is refused."""
    status = program.status
    if status is None or REFUSED not in status.failures:
        return []
    condition = program.nodes[program.results[status.output][0]].args[0]
    results = dict.fromkeys(index for k, row in enumerate(program.results) if not program.is_status(k) for index in row)
    return [
        index for index in results if program.nodes[index].op is Op.SELECT and program.nodes[index].args[0] == condition
    ]


def _trigonometry(program: Program) -> dict[int, dict[Op, int]]:
    """For each node that is an angle, the nodes of its sine and cosine, by operation."""
    pairs: dict[int, dict[Op, int]] = {}
    for index, node in enumerate(program.nodes):
        if node.op in (Op.SIN, Op.COS):
            pairs.setdefault(node.args[0], {})[node.op] = index
    return {angle: dict(sorted(pair.items(), key=lambda item: item[0] is Op.COS)) for angle, pair in pairs.items()}


def _joint_sums(program: Program, angles: set[int]) -> dict[int, tuple[int, ...]]:
    """Joint numbers (from 1) of the angles that are a joint variable or a sum of some."""
    sums: dict[int, tuple[int, ...]] = {}
    for index, node in enumerate(program.nodes):
        if node.op is Op.INPUT and program.inputs[node.place[0]].role is Role.POSITION:
            sums[index] = (node.place[1] + 1,)
        elif node.op is Op.ADD and node.args[0] in sums and node.args[1] in sums:
            sums[index] = tuple(sorted(sums[node.args[0]] + sums[node.args[1]]))
    return {index: joints for index, joints in sums.items() if index in angles}


def _joint_name(letter: str, joints: tuple[int, ...] | None) -> str:
    return letter + "".join(map(str, joints)) if joints else ""
