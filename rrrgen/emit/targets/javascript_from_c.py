"""The emitted C of the inverse kinematics as JavaScript: the same statements, read from its text.

The C that rrrgen emits has no heap and no recursion, its local arrays have constant sizes, and its pointers point to
numbers, arrays of numbers and structures of these. So all arrays lie at fixed places of two typed arrays, ``F64`` for
reals and ``I32`` for integers, and a pointer is an index into one of them. Scalars stay local variables; a structure is
an object that holds the places of its fields. What is read is the subset of C in which ``templates/c/ik`` is written:
anything else raises :class:`InternalError`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from rrrgen.base.errors import InternalError

_TOKEN = re.compile(
    r"(?P<comment>/\*.*?\*/)|(?P<directive>^[ \t]*#(?:\\\n|/\*.*?\*/|[^\n])*)|(?P<space>\s+)"
    r'|(?P<string>"(?:\\.|[^"\\])*")|(?P<number>0x[0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?P<suffix>[uUfF]*)'
    r"|(?P<name>[A-Za-z_]\w*)|(?P<sign>->|\+\+|--|<<=|>>=|<<|>>|[-+*/%&|^!=<>]=|&&|\|\||[-+*/%&|^~!<>=?:;,.(){}\[\]])",
    re.DOTALL | re.MULTILINE,
)
_MATH = {"sqrt": "sqrt", "fabs": "abs", "sin": "sin", "cos": "cos", "floor": "floor", "ceil": "ceil"}
_IGNORED = frozenset({"const", "static", "inline", "extern", "restrict"})
_LEVELS = (
    {"||"},
    {"&&"},
    {"|"},
    {"^"},
    {"&"},
    {"==", "!="},
    {"<", ">", "<=", ">="},
    {"<<", ">>"},
    {"+", "-"},
    {"*", "/", "%"},
)
_ASSIGNING = frozenset({"=", "+=", "-=", "*=", "/=", "%=", "&=", "|=", "^="})
_TERNARY, _UNARY, _PRIMARY = 0.5, 11.0, 12.0
_RESERVED = frozenset({"in", "function", "var", "let", "of", "arguments", "eval", "await", "yield", "undefined", "NaN"})


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    line_start: bool = False


@dataclass(frozen=True)
class _Type:
    """A type: ``kind`` is real, int, unsigned, void, struct, array or pointer.

    ``of`` is what an array or a pointer consists of, ``size`` the length of an array, ``fields`` those of a structure.
    """

    kind: str
    of: _Type | None = None
    size: int = 0
    fields: tuple[tuple[str, _Type], ...] = ()

    @property
    def numbers(self) -> int:
        """How many numbers an object of this type has."""
        return self.size * self.inner.numbers if self.kind == "array" else 1

    @property
    def inner(self) -> _Type:
        """What an array or a pointer consists of."""
        if self.of is None:
            raise InternalError(f"a {self.kind} is used as a pointer in the emitted inverse kinematics")
        return self.of

    @property
    def scalar(self) -> _Type:
        """The type of the numbers of an array."""
        return self.inner.scalar if self.kind == "array" else self

    @property
    def heap(self) -> str:
        """The typed array that holds its numbers."""
        return "F64" if self.scalar.kind == "real" else "I32"


_REAL, _INT, _UNSIGNED, _VOID = (_Type(kind) for kind in ("real", "int", "unsigned", "void"))
_TYPES = {
    "double": _REAL, "int": _INT, "unsigned": _UNSIGNED, "bool": _INT, "void": _VOID, "char": _INT, "size_t": _UNSIGNED,
}  # fmt: skip


@dataclass(frozen=True)
class _Value:
    """A JavaScript expression with the C type of its value, its binding level, and its place if it has one.

    The place of a number in memory is ``terms`` (indices in JavaScript) plus ``shift``; ``placed`` says that there is
    one. The value of an array is its place.
    """

    code: str
    type: _Type
    level: float = _PRIMARY
    terms: tuple[str, ...] = ()
    shift: int = 0
    placed: bool = False

    def within(self, level: float) -> str:
        """Its code, in parentheses unless it binds at least as strongly as ``level``."""
        return self.code if self.level >= level else f"({self.code})"


def _place(type_: _Type, terms: Sequence[str], shift: int) -> _Value:
    """The object of ``type_`` at a place: of an array the place itself, else the number there."""
    parts = [*terms, *([str(shift)] if shift or not terms else [])]
    where = " + ".join(parts)
    if type_.kind in ("array", "struct"):
        return _Value(where, type_, _PRIMARY if len(parts) == 1 else 9.0, tuple(terms), shift, placed=True)
    return _Value(f"{type_.heap}[{where}]", type_, _PRIMARY, tuple(terms), shift, placed=True)


@dataclass
class _CFunction:
    """A C function: its comment, result, parameters and the tokens of its body."""

    name: str
    comment: str
    result: _Type
    parameters: list[tuple[str, _Type]]
    body: list[_Token]


@dataclass(frozen=True)
class Translation:
    """JavaScript ``lines`` of a C function and of everything it calls; ``places`` of the arguments of a call.

    ``places`` has for every parameter the place of an array for it (a structure: those of its fields by name).
    """

    lines: tuple[str, ...]
    places: Mapping[str, int | Mapping[str, int]]


def translate(header: str, source: str, function: str, arrays: Mapping[str, int]) -> Translation:
    """Translate ``function`` and what it calls; ``arrays`` are the lengths of the arrays that it takes by name."""
    unit = _Unit()
    unit.read(header)
    unit.read(source)
    return unit.translation(function, arrays)


class _Unit:
    """The declarations of a header and a source, and the memory of what is translated."""

    def __init__(self) -> None:
        self.types: dict[str, _Type] = dict(_TYPES)
        self.constants: dict[str, int] = {}
        self.functions: dict[str, _CFunction] = {}
        self.tables: dict[str, _Value] = {}
        self.used = {"F64": 1, "I32": 1}  # place 0 is the null pointer
        self.initial: list[str] = []
        self.inlined: dict[str, tuple[str, list[_Token]]] = {}
        self._macros: dict[str, list[_Token]] = {}

    def read(self, text: str) -> None:
        """Take over the declarations of a file."""
        cursor = _Cursor(list(self._tokens(text)))
        comment = ""
        while not cursor.done:
            token = cursor.peek()
            if token.kind == "comment":
                comment = cursor.next().text
                continue
            self._declaration(cursor, comment)
            comment = ""

    def _tokens(self, text: str) -> Iterator[_Token]:
        """The tokens of a file, macros expanded; of its conditions, C99 without extensions holds."""
        kept: list[bool] = []
        fresh = True  # at the start of a line
        position = 0
        while position < len(text):
            match = _TOKEN.match(text, position)
            if match is None:
                raise InternalError(
                    f"the emitted C has a character that is not understood: {text[position : position + 20]!r}"
                )
            position = match.end()
            kind = "number" if match["number"] is not None else str(match.lastgroup)
            if kind == "space":
                fresh = fresh or "\n" in match[0]
            elif kind == "directive":
                self._directive(re.sub(r"/\*.*?\*/", "", match[0]).split(None, 2), kept)
            elif all(kept):
                number = kind == "number"
                token = _Token(kind, match[0].rstrip("fF") if number and "x" not in match[0] else match[0], fresh)
                yield from self._macros.get(token.text, (token,)) if kind == "name" else (token,)
                fresh = False

    def _directive(self, words: list[str], kept: list[bool]) -> None:
        what = words[0].removeprefix("#")
        if what == "ifndef":
            kept.append(True)
        elif what in ("ifdef", "if"):
            kept.append(False)  # C++, or a compiler of its own
        elif what == "else":
            kept[-1] = not kept[-1]
        elif what == "endif":
            kept.pop()
        elif what == "define" and all(kept):
            body = list(self._tokens(words[2])) if len(words) > 2 else []
            name, _, parameter = words[1].partition("(")
            if parameter:
                self.inlined[name] = (parameter.removesuffix(")"), body)
            else:
                self._macros[name] = body

    def _declaration(self, cursor: _Cursor, comment: str) -> None:
        if cursor.take("typedef"):
            self._named_type(cursor)
            return
        if cursor.peek().text == "enum":
            self._enumeration(cursor)
            cursor.expect(";")
            return
        base = self.base(cursor)
        stars = 0
        while cursor.take("*"):
            stars += 1
            cursor.skip(_IGNORED)
        name = cursor.next().text
        if cursor.peek().text != "(":
            type_ = self.read_dimensions(cursor, base)
            self.tables[name] = self.table(name, type_, cursor.initial() if cursor.take("=") else [])
            cursor.expect(";")
            return
        parameters = self._parameters(cursor)
        if cursor.take(";"):
            return
        result = _Type("pointer", base) if stars else base
        self.functions[name] = _CFunction(name, comment, result, parameters, cursor.block())

    def _named_type(self, cursor: _Cursor) -> None:
        if cursor.peek().text == "enum":
            self._enumeration(cursor)
            type_ = _INT
        elif cursor.take("struct"):
            cursor.next()
            cursor.expect("{")
            fields = []
            while not cursor.take("}"):
                cursor.comments()
                base, name = self.base(cursor), cursor.next().text
                fields.append((name, self.read_dimensions(cursor, base)))
                cursor.expect(";")
                cursor.comments()
            type_ = _Type("struct", fields=tuple(fields))
        else:
            type_ = self.base(cursor)
        self.types[cursor.next().text] = type_
        cursor.expect(";")

    def _enumeration(self, cursor: _Cursor) -> None:
        cursor.expect("enum")
        if cursor.peek().text != "{":
            cursor.next()
        cursor.expect("{")
        while not cursor.take("}"):
            cursor.comments()
            name = cursor.next().text
            cursor.expect("=")
            self.constants[name] = int(cursor.next().text)
            cursor.take(",")
            cursor.comments()

    def base(self, cursor: _Cursor) -> _Type:
        """The type that a declaration begins with."""
        cursor.skip(_IGNORED)
        if cursor.take("signed"):
            cursor.expect("char")
            return _INT
        name = cursor.next().text
        if name not in self.types:
            raise InternalError(f"the emitted C has a type that is not understood: {name}")
        cursor.skip(_IGNORED)
        return self.types[name]

    def is_type(self, token: _Token) -> bool:
        """Whether a declaration or a cast begins with ``token``."""
        return token.kind == "name" and (token.text in self.types or token.text in ("const", "static", "signed"))

    def read_dimensions(self, cursor: _Cursor, base: _Type) -> _Type:
        """The type with the sizes of an array that follow its name."""
        sizes = []
        while cursor.take("["):
            cursor.skip(_IGNORED)
            sizes.append(0 if cursor.take("]") else self._whole(cursor))
        for size in reversed(sizes):
            base = _Type("array", base, size)
        return base

    def _whole(self, cursor: _Cursor) -> int:
        """The whole number before a closing bracket: numbers and names of constants, added up."""
        total = 0
        while True:
            token = cursor.next()
            total += self.constants[token.text] if token.kind == "name" else int(token.text)
            if cursor.take("]"):
                return total
            cursor.expect("+")

    def _parameters(self, cursor: _Cursor) -> list[tuple[str, _Type]]:
        cursor.expect("(")
        parameters: list[tuple[str, _Type]] = []
        if cursor.peek().text == "void" and cursor.peek(1).text == ")":
            cursor.next()
        while not cursor.take(")"):
            name, type_ = self.declarator(cursor, self.base(cursor))
            parameters.append((name, _Type("pointer", type_.inner) if type_.kind == "array" else type_))
            cursor.take(",")
        return parameters

    def declarator(self, cursor: _Cursor, base: _Type) -> tuple[str, _Type]:
        """Name and type of what is declared: a number, an array, or a pointer to one of them."""
        if cursor.take("("):
            cursor.expect("*")
            cursor.skip(_IGNORED)
            name = cursor.next().text
            cursor.expect(")")
            return name, _Type("pointer", self.read_dimensions(cursor, base))
        pointer = cursor.take("*")
        cursor.skip(_IGNORED)
        name = cursor.next().text
        type_ = self.read_dimensions(cursor, base)
        return name, _Type("pointer", type_) if pointer else type_

    def reserve(self, type_: _Type) -> int:
        """The place of a new array or number."""
        at = self.used[type_.heap]
        self.used[type_.heap] += type_.numbers
        return at

    def structure(self, type_: _Type) -> dict[str, int]:
        """The places of the fields of a new structure."""
        return {name: self.reserve(field_type) for name, field_type in type_.fields}

    def table(self, name: str, type_: _Type, values: list[str]) -> _Value:
        """A table of constants, whose first numbers are ``values`` and the others zero."""
        at = self.reserve(type_)
        if any(float(value) for value in values):
            self.initial.append(f"{type_.heap}.set([{', '.join(values)}], {at});  // {name}")
        return _place(type_, (), at)

    def translation(self, name: str, arrays: Mapping[str, int]) -> Translation:
        """The function ``name``, what it calls, and memory for its arguments."""
        wanted, texts = [name], {}
        while wanted:
            now = wanted.pop()
            if now not in texts:
                body = _Translation(self, self.functions[now])
                texts[now] = body.lines()
                wanted += body.called
        places: dict[str, int | Mapping[str, int]] = {}
        for parameter, type_ in self.functions[name].parameters:
            if type_.kind == "pointer":
                whole = type_.inner.kind == "struct"
                array = _Type("array", type_.inner, 0 if whole else arrays[parameter])
                places[parameter] = self.structure(type_.inner) if whole else self.reserve(array)
        lines = [f"const F64 = new Float64Array({self.used['F64']}), I32 = new Int32Array({self.used['I32']});"]
        lines += self.initial
        for function in self.functions:
            lines += ["", *texts[function]] if function in texts else []
        return Translation(tuple(lines), places)


class _Cursor:
    """A place in a list of tokens."""

    def __init__(self, tokens: list[_Token]) -> None:
        self._tokens, self._at = tokens, 0

    @property
    def done(self) -> bool:
        return self._at >= len(self._tokens)

    def peek(self, ahead: int = 0) -> _Token:
        at = self._at + ahead
        return self._tokens[at] if at < len(self._tokens) else _Token("end", "")

    def next(self) -> _Token:
        token = self.peek()
        self._at += 1
        return token

    def take(self, text: str) -> bool:
        match = self.peek().text == text
        self._at += match
        return match

    def expect(self, text: str) -> None:
        if not self.take(text):
            around = " ".join(token.text for token in self._tokens[max(self._at - 8, 0) : self._at + 4])
            raise InternalError(f"the emitted C has no {text} where one is expected: {around}")

    def skip(self, words: frozenset[str]) -> None:
        while self.peek().text in words:
            self._at += 1

    def insert(self, tokens: Sequence[_Token]) -> None:
        """Put tokens before the next one."""
        self._tokens[self._at : self._at] = tokens

    def argument(self) -> list[_Token]:
        """The tokens of the only argument of a call, without its parentheses."""
        self.expect("(")
        begin, depth = self._at, 1
        while depth:
            text = self.next().text
            depth += (text == "(") - (text == ")")
        return self._tokens[begin : self._at - 1]

    def comments(self) -> None:
        """Skip comments."""
        while self.peek().kind == "comment":
            self._at += 1

    def block(self) -> list[_Token]:
        """The tokens of a block in braces, without them."""
        self.expect("{")
        begin, depth = self._at, 1
        while depth:
            text = self.next().text
            depth += (text == "{") - (text == "}")
        return self._tokens[begin : self._at - 1]

    def initial(self) -> list[str]:
        """The numbers in the braces of an initial value, whatever their casts."""
        numbers, depth, sign = [], 0, ""
        while True:
            token = self.next()
            depth += (token.text == "{") - (token.text == "}")
            if token.text == "-":
                sign = "-"
            elif token.kind == "number":
                numbers.append(sign + token.text.rstrip("uU"))
                sign = ""
            if depth == 0:
                return numbers


def _statements_and_comments(tokens: Sequence[_Token]) -> Iterator[_Token]:
    """The tokens of a body without the comments that stand beside or inside a statement."""
    before = "{"
    for token in tokens:
        if token.kind != "comment":
            before = token.text
            yield token
        elif token.line_start and before in ("{", "}", ";"):
            yield token


@dataclass
class _Translation:
    """Translates the body of one function."""

    unit: _Unit
    function: _CFunction
    called: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        tokens = list(_statements_and_comments(self.function.body))
        self._cursor = _Cursor(tokens)
        self._addressed = {
            after.text
            for before, sign, after, then in zip(tokens, tokens[1:], tokens[2:], tokens[3:], strict=False)
            if sign.text == "&" and before.text in ("(", ",", "=") and then.text not in ("[", "->", ".")
        }
        self._scopes: list[dict[str, _Value]] = [dict(unit_tables(self.unit)), {}]
        self._depth = 1
        self._out: list[str] = []

    def lines(self) -> list[str]:
        """The JavaScript of the function."""
        names = []
        for name, type_ in self.function.parameters:
            if name in self._addressed:
                raise InternalError(f"the address of the argument {name} of {self.function.name} is taken")
            names.append(self._declare(name, type_))
        while not self._cursor.done:
            self._statement()
        comment = self.function.comment.split("\n")
        head = f"function {self.function.name}({', '.join(names)}) {{"
        return [*(line.rstrip() for line in comment if line), head, *self._out, "}"]

    # -- statements ------------------------------------------------------------------------------------------------

    def _line(self, text: str) -> None:
        self._out.append("  " * self._depth + text)

    def _statement(self) -> None:
        cursor = self._cursor
        token = cursor.peek()
        if token.kind == "comment":
            for line in cursor.next().text.split("\n"):
                self._line(line.strip() if line.startswith("/*") else f" {line.strip()}")
        elif cursor.take(";"):
            return
        elif token.text == "{":
            self._line("{")
            self._inside()
            self._line("}")
        elif token.text == "if":
            self._if()
        elif cursor.take("for"):
            self._scopes.append({})
            cursor.expect("(")
            begin = self._begin()
            condition = "" if cursor.peek().text == ";" else self._expression().code
            cursor.expect(";")
            step = "" if cursor.peek().text == ")" else self._expression().code
            cursor.expect(")")
            self._loop(f"for ({begin}; {condition}; {step})")
            self._scopes.pop()
        elif cursor.take("while"):
            cursor.expect("(")
            condition = self._expression().code
            cursor.expect(")")
            self._loop(f"while ({condition})")
        elif token.text in ("break", "continue"):
            self._line(f"{cursor.next().text};")
            cursor.expect(";")
        elif cursor.take("return"):
            value = "" if cursor.peek().text == ";" else f" {self._expression().code}"
            self._line(f"return{value};")
            cursor.expect(";")
        elif self.unit.is_type(token):
            self._variables()
        else:
            self._effect()

    def _begin(self) -> str:
        """The first part of the head of a loop: an expression, a declaration or nothing."""
        cursor = self._cursor
        if not self.unit.is_type(cursor.peek()):
            begin = "" if cursor.peek().text == ";" else self._expression().code
        else:
            name, type_ = self.unit.declarator(cursor, self.unit.base(cursor))
            cursor.expect("=")
            value = self._assignment().code
            begin = f"let {self._declare(name, type_)} = {value}"
        cursor.expect(";")
        return begin

    def _inside(self) -> None:
        """The statements of a block in braces."""
        self._cursor.expect("{")
        self._scopes.append({})
        self._depth += 1
        while not self._cursor.take("}"):
            self._statement()
        self._depth -= 1
        self._scopes.pop()

    def _loop(self, head: str) -> None:
        self._line(f"{head} {{")
        self._inside()
        self._line("}")

    def _if(self) -> None:
        head, cursor = "if", self._cursor
        while True:
            cursor.expect("if")
            cursor.expect("(")
            self._line(f"{head} ({self._expression().code}) {{")
            cursor.expect(")")
            self._inside()
            if not cursor.take("else"):
                break
            if cursor.peek().text == "if":
                head = "} else if"
                continue
            self._line("} else {")
            self._inside()
            break
        self._line("}")

    def _effect(self) -> None:
        """An expression that is a statement; one of a variable alone, a note that it is not used, is left out."""
        cursor = self._cursor
        if cursor.peek().text == "(" and cursor.peek(1).text == "void":
            for text in ("(", "void", ")"):
                cursor.expect(text)
            if cursor.peek(1).text == ";":
                cursor.next()
                cursor.expect(";")
                return
            if cursor.take("memset"):
                self._clear()
                return
        self._line(f"{self._expression().code};")
        cursor.expect(";")

    def _clear(self) -> None:
        """``memset(&object, 0, sizeof(object))``."""
        cursor = self._cursor
        cursor.expect("(")
        cursor.take("&")
        name = cursor.next().text
        for text in (",", "0", ",", "sizeof", "(", name, ")", ")", ";"):
            cursor.expect(text)
        value = self._look_up(name)
        if value.type.kind == "struct":
            for field_name, type_ in value.type.fields:
                place = f"{value.code}.{field_name}"
                self._line(f"{type_.heap}.fill(0, {place}, {place} + {type_.numbers});")
        else:
            self._line(f"{value.type.heap}.fill(0, {value.code}, {value.code} + {value.type.numbers});")

    def _variables(self) -> None:
        cursor = self._cursor
        fixed, static = False, False
        while cursor.peek().text in _IGNORED:
            word = cursor.next().text
            fixed, static = fixed or word == "const", static or word == "static"
        base = self.unit.base(cursor)
        while True:
            name, type_ = self.unit.declarator(cursor, base)
            if static:
                cursor.expect("=")
                self._scopes[-1][name] = self.unit.table(f"{self.function.name}, {name}", type_, cursor.initial())
            elif type_.kind == "array":
                self._array(name, type_)
            elif type_.kind == "struct":
                places = ", ".join(f"{key}: {at}" for key, at in self.unit.structure(type_).items())
                self._line(f"const {self._declare(name, type_)} = {{ {places} }};")
            elif name in self._addressed:
                self._scopes[-1][name] = _place(type_, (), self.unit.reserve(type_))
                if cursor.take("="):
                    self._line(f"{self._scopes[-1][name].code} = {self._assignment().code};")
            else:
                value = f" = {self._assignment().code}" if cursor.take("=") else ""
                word = "const" if value and fixed and type_.kind != "pointer" else "let"
                self._line(f"{word} {self._declare(name, type_)}{value};")
            if cursor.take(";"):
                return
            cursor.expect(",")

    def _array(self, name: str, type_: _Type) -> None:
        """A local array: its numbers, if it has some, are set where it is declared."""
        at = self.unit.reserve(type_)
        local = self._declare(name, type_)
        self._line(f"const {local} = {at};")
        if not self._cursor.take("="):
            return
        values: list[str] = []
        self._flat(values)
        if len(values) < type_.numbers:
            self._line(f"{type_.heap}.fill(0, {local}, {local} + {type_.numbers});")
        for k, value in enumerate(values):
            if value != "0":
                self._line(f"{_place(type_.scalar, (local,), k).code} = {value};")

    def _flat(self, values: list[str]) -> None:
        """The expressions in the braces of an initial value."""
        cursor = self._cursor
        cursor.expect("{")
        while not cursor.take("}"):
            if cursor.peek().text == "{":
                self._flat(values)
            else:
                values.append(self._assignment().code)
            cursor.take(",")

    def _declare(self, name: str, type_: _Type) -> str:
        local = f"{name}_" if name in _RESERVED else name
        placed = type_.kind in ("array", "struct")
        self._scopes[-1][name] = _Value(local, type_, terms=(local,) if placed else (), placed=placed)
        return local

    # -- expressions -----------------------------------------------------------------------------------------------

    def _look_up(self, name: str) -> _Value:
        for scope in reversed(self._scopes):
            if name in scope:
                return scope[name]
        if name in self.unit.constants:
            return _Value(str(self.unit.constants[name]), _INT)
        raise InternalError(f"the emitted C has a name that is not understood: {name}")

    def _expression(self) -> _Value:
        value = self._assignment()
        while self._cursor.take(","):
            value = _Value(f"{value.code}, {self._assignment().code}", _VOID, -1.0)
        return value

    def _assignment(self) -> _Value:
        left = self._choice()
        sign = self._cursor.peek().text
        if sign not in _ASSIGNING:
            return left
        self._cursor.next()
        right = self._assignment()
        if sign in ("/=", "%=") and left.type.kind != "real":
            return _Value(f"{left.code} = Math.trunc({left.code} {sign[0]} {right.within(10.5)})", left.type, 0.0)
        return _Value(f"{left.code} {sign} {right.within(0.0)}", left.type, 0.0)

    def _choice(self) -> _Value:
        condition = self._binary(0)
        if not self._cursor.take("?"):
            return condition
        first = self._assignment()
        self._cursor.expect(":")
        second = self._choice()
        kinds = {first.type.kind, second.type.kind}
        type_ = _REAL if "real" in kinds else first.type
        code = f"{condition.within(1.0)} ? {first.within(_TERNARY)} : {second.within(_TERNARY)}"
        return _Value(code, type_, _TERNARY)

    def _binary(self, level: int) -> _Value:
        if level == len(_LEVELS):
            return self._unary()
        left = self._binary(level + 1)
        while self._cursor.peek().text in _LEVELS[level]:
            sign = self._cursor.next().text
            left = self._combine(left, sign, self._binary(level + 1), level + 1.0)
        return left

    @staticmethod
    def _combine(left: _Value, sign: str, right: _Value, level: float) -> _Value:
        """Two values joined by an operator of the C level ``level``."""
        if left.type.kind in ("pointer", "array") and sign in ("+", "-"):
            inner, step = left.type.inner, right.within(10.0)
            step = step if inner.numbers == 1 else f"{inner.numbers} * {right.within(10.5)}"
            return _Value(f"{left.within(9.0)} {sign} {step}", _Type("pointer", inner), 9.0)
        code = f"{left.within(level)} {sign} {right.within(level + 0.5)}"
        if sign in ("==", "!=", "<", ">", "<=", ">=", "&&", "||"):
            return _Value(code, _INT, level)
        kinds = {left.type.kind, right.type.kind}
        if "real" in kinds:
            return _Value(code, _REAL, level)
        type_ = _UNSIGNED if "unsigned" in kinds else _INT
        if sign in ("/", "%"):
            return _Value(f"Math.trunc({code})", type_)
        if type_ == _UNSIGNED and sign in ("|", "^", "&", "<<", ">>"):
            return _Value(f"({code} >>> 0)", type_)
        return _Value(code, type_, level)

    def _unary(self) -> _Value:
        cursor, token = self._cursor, self._cursor.peek()
        if token.text == "(" and self.unit.is_type(cursor.peek(1)):
            cursor.next()
            type_ = self.unit.base(cursor)
            pointer = cursor.take("*")
            cursor.skip(_IGNORED)
            cursor.expect(")")
            value = self._unary()
            return replace(value, type=_Type("pointer", type_)) if pointer else self._cast(value, type_)
        if token.text in ("-", "+", "!", "~"):
            cursor.next()
            value = self._unary()
            spaced = " " if value.code.startswith(token.text) else ""
            type_ = _INT if token.text == "!" else value.type
            return _Value(f"{token.text}{spaced}{value.within(_UNARY)}", type_, _UNARY)
        if token.text in ("++", "--"):
            cursor.next()
            value = self._unary()
            return _Value(f"{token.text}{value.code}", value.type, _UNARY)
        if cursor.take("*"):
            return self._deref(self._unary())
        if cursor.take("&"):
            value = self._unary()
            if value.type.kind == "struct":
                return replace(value, type=_Type("pointer", value.type))
            if not value.placed:
                raise InternalError(f"{self.function.name} takes the address of {value.code}, which has none")
            parts = [*value.terms, *([str(value.shift)] if value.shift or not value.terms else [])]
            return _Value(" + ".join(parts), _Type("pointer", value.type), 9.0)
        return self._postfix()

    @staticmethod
    def _cast(value: _Value, type_: _Type) -> _Value:
        if type_.kind in ("int", "unsigned") and value.type.kind == "real":
            return _Value(f"Math.trunc({value.code})", type_)
        if type_.kind == "unsigned" and value.type.kind == "int" and not value.code.isdecimal():
            return _Value(f"({value.within(8.5)} >>> 0)", type_)
        return replace(value, type=type_)

    @staticmethod
    def _deref(value: _Value) -> _Value:
        if value.type.inner.kind == "struct":
            return replace(value, type=value.type.inner)
        if value.type.kind == "array" and value.placed:
            return _place(value.type.inner, value.terms, value.shift)
        return _place(value.type.inner, (value.within(9.0),), 0)

    def _postfix(self) -> _Value:
        value = self._primary()
        cursor = self._cursor
        while True:
            if cursor.take("["):
                index = self._expression()
                cursor.expect("]")
                value = self._element(value, index)
            elif cursor.peek().text in (".", "->"):
                arrow = cursor.next().text == "->"
                struct = value.type.inner if arrow else value.type
                name = cursor.next().text
                value = _place(dict(struct.fields)[name], (f"{value.code}.{name}",), 0)
            elif cursor.peek().text in ("++", "--"):
                value = _Value(f"{value.code}{cursor.next().text}", value.type, _UNARY)
            else:
                return value

    @staticmethod
    def _element(value: _Value, index: _Value) -> _Value:
        inner = value.type.inner
        known = value.type.kind == "array" and value.placed
        terms, shift = (value.terms, value.shift) if known else ((value.within(9.0),), 0)
        if index.code.isdecimal():
            return _place(inner, terms, shift + int(index.code) * inner.numbers)
        step = index.within(9.0) if inner.numbers == 1 else f"{inner.numbers} * {index.within(10.5)}"
        return _place(inner, (*terms, step), shift)

    def _primary(self) -> _Value:
        cursor = self._cursor
        token = cursor.next()
        if token.text == "(":
            value = self._expression()
            cursor.expect(")")
            plain = value.level == _PRIMARY
            return value if plain else replace(value, code=f"({value.code})", level=_PRIMARY)
        if token.kind == "number":
            unsigned = token.text[-1] in "uU"
            whole = unsigned or token.text.startswith("0x") or token.text.isdecimal()
            return _Value(token.text.rstrip("uU"), _UNSIGNED if unsigned else _INT if whole else _REAL)
        if token.text == "NULL":
            return _Value("0", _INT)
        if token.text in ("true", "false"):
            return _Value(token.text, _INT)
        if token.text in self.unit.inlined:
            parameter, body = self.unit.inlined[token.text]
            given = cursor.argument()
            cursor.insert([new for old in body for new in (given if old.text == parameter else [old])])
            return self._primary()
        if cursor.peek().text == "(":
            return self._call(token.text)
        return self._look_up(token.text)

    def _call(self, name: str) -> _Value:
        cursor = self._cursor
        cursor.expect("(")
        arguments = []
        while not cursor.take(")"):
            arguments.append(self._assignment().code)
            cursor.take(",")
        given = ", ".join(arguments)
        if name in _MATH:
            return _Value(f"Math.{_MATH[name]}({given})", _REAL)
        if name == "copysign":
            return _Value(f"copysign({given})", _REAL)
        if name not in self.unit.functions:
            raise InternalError(f"the emitted C calls a function that is not understood: {name}")
        self.called.append(name)
        return _Value(f"{name}({given})", self.unit.functions[name].result)


def unit_tables(unit: _Unit) -> Mapping[str, _Value]:
    """The constant tables of a file by name."""
    return unit.tables
