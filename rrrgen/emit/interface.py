"""The protocols, checked by mypy, of a backend and of a target language of the shared printer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from rrrgen.program import Op, Port, Status

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit import Real
    from rrrgen.robot.identity import Identity

CHOICE, SUM, PRODUCT, UNARY, ATOM = range(5)
"""Binding strength (operator precedence) of printed expressions, weakest first."""


class Text(NamedTuple):
    """A printed expression: its text ``code``, and how tightly its outermost operation binds (``strength``).

    ``quotient`` says whether that operation is a division.
    """

    code: str
    strength: int = ATOM
    quotient: bool = False

    def within(self, strength: int) -> str:
        """The characters, in parentheses unless they bind at least as tightly as ``strength``."""
        return self.code if self.strength >= strength else f"({self.code})"


@dataclass(frozen=True)
class SelfTestCheck:
    """A part of the self-test for functions that are not printed from programs.

    ``text`` is the C of ``static int <function>(void)``, which reports and returns 1 after a failure, 0 otherwise, and
    tests what ``header`` declares. Where ``digested``, its argument is ``uint64_t *bits``, the digest of all results.
    """

    function: str
    header: str
    text: str
    digested: bool = False


@dataclass(frozen=True)
class RoundingStatement:
    """What is proven about the rounding error of a function.

    ``sentence`` is for the comment in front of its prototype, ``data`` the entry ``rounding`` of the manifest.
    """

    sentence: str
    data: Mapping[str, Any]


Rounding = Mapping[str, RoundingStatement]
"""The statements about the functions of a model, by the names of the functions."""


class Target(Protocol):
    """A language with infix arithmetic, in which :mod:`rrrgen.emit.printing` writes expressions."""

    @property
    def explicit(self) -> bool:
        """Whether products in sums are put in parentheses, ``(a*b) + c``, as coding rules for C ask."""
        ...

    @property
    def reserved(self) -> frozenset[str]:
        """Names that local variables must not have, such as keywords of the language."""
        ...

    def literal(self, value: Fraction | int) -> str:
        """A constant that reads back to the nearest number of the file's real type."""
        ...

    def declaration(self, name: str, value: str) -> str:
        """The statement that gives ``value`` a name."""
        ...

    def call(self, op: Op, argument: str) -> str:
        """The call of the function for ``op``, one of SQRT, ABS, EXP, TANH, with ``argument``."""
        ...

    def sign(self, x: Text) -> Text:
        """The expression of the sign of ``x``, -1, 0 or 1; ``x`` is the name of a variable."""
        ...

    def minimum(self, x: Text, y: Text) -> Text:
        """The expression of the smaller of ``x`` and ``y``, names of variables or numbers."""
        ...

    def select(self, condition: Text, positive: Text, otherwise: Text) -> Text:
        """The expression that is ``positive`` where ``condition > 0``, else ``otherwise``."""
        ...

    def sincos(self, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """Statements that declare ``sine`` and ``cosine``, each if it is not None, of the expression ``angle``."""
        ...


class FunctionTarget(Target, Protocol):
    """A language whose functions read and write ports by name."""

    def element(self, port: Port, element: int, output: bool = False) -> str:
        """Element number ``element``, row-major, of an input or output."""
        ...

    def discard(self, port: Port) -> str:
        """The statement that prevents a compiler's warning about an input that the function does not read."""
        ...

    def branch(self, condition: Text, yes: Sequence[str], no: Sequence[str]) -> list[str]:
        """The statements ``yes`` where ``condition > 0``, else the statements ``no``."""
        ...

    def outcome(self, status: Status, value: Text) -> list[str]:
        """The statements that report the status: ``value`` is 0 after success, 1 after failure; NaN is a failure."""
        ...


class Backend(Protocol):
    """Prints a derived model as files of one language."""

    def tasks(self, model: DerivedModel, identity: Identity, real: Real) -> Sequence[Callable[[], Any]]:
        """Independent pieces of the work, which may run in processes of their own."""
        ...

    def assemble(self, model: DerivedModel, identity: Identity, results: Sequence[Any]) -> dict[str, str]:
        """Make the files, relative path -> text, from the ``results`` of the tasks, in the order of the tasks."""
        ...
