"""The entries of the table of model functions: data alone, so that nothing heavy is imported to read the table."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

from rrrgen.derive.functions.quantities import QUANTITIES, ArgumentKind


def about_tip(text: str, tip: str) -> str:
    """What ``text``, a text about the tip of the robot or its last link, says about the named ``tip``."""
    if not text:
        return text
    named = {"its last link": f"the link of the tip {tip}", "the last link": f"the link of the tip {tip}"}
    found = re.sub(r"\b(its last link|the last link|the tip)\b", lambda m: named.get(m[1], f"the tip {tip}"), text)
    return f"{text.removesuffix('.')}, at the tip {tip}." if found == text and text.endswith(".") else found


class Needs(Enum):
    """What the robot must have for a function to exist."""

    NOTHING = "nothing"
    FRICTION = "friction"
    FRICTION_STATE = "a friction law with a state"
    FLOATING_BASE = "a floating base"
    TIP_POSITION = "joints that move the position of the tip"
    TIP_POSE = "joints that move the position of the tip, and joints that turn it"
    LOOPS = "closed loops"
    NEWTON = "closed loops that Newton's method solves"
    SHARED_JOINTS = "a named tip that shares joints with others"


@dataclass(frozen=True)
class ModelFunction:
    """One function of the model.

    ``summary`` is its first sentence, ``details`` are further paragraphs, ``returns`` describes its results, ``raises``
    its errors by type. ``takes`` lists its arguments in Python, those behind "*" given by keyword: quantities of
    ``where``, or else of :data:`rrrgen.derive.functions.quantities.QUANTITIES`. ``result`` is the named tuple in
    :mod:`rrrgen.runtime.results` of a function with several results. ``status``: it can fail, and then raises an error
    or, on request, returns a status. ``refuses``: it refuses unusable input (:mod:`rrrgen.program.guard`), and this is
    what its results are then. ``links_only`` names a result that ends with elements for the drive inertias,
    which Python cuts off. ``by_hand``: its method in Python is not made from the table.

    ``record`` names the recorder as "module:NAME", which is loaded when the function is derived: a function that takes
    a :class:`FunctionBuilder` and returns a :class:`Program`, or a tuple of such functions, whose programs are
    equivalent; the cheapest is emitted. ``combine`` names, likewise, a function that takes a :class:`FunctionBuilder`
    and the optimized programs of the functions ``of``: its program is another alternative, or, without ``record``, the
    only one. A function with ``of`` thus follows those in the table. ``differentiated``: its program is made of
    derivatives of the others, so that the numbers of the robot file are also tried in its general program instead of
    in theirs. ``more_joints_than``, ``most_joints`` (0 for any number) and ``needs`` say for which robots the function
    exists, and ``absent`` why it does not; with ``closed_loops`` False it does not for robots with such loops.
    ``of_tip``: it is about the tip, and a robot with named tips has one for each of them too (:meth:`at_tip`); ``tip``
    is the name of that tip. ``on_demand``: it takes long to derive and few programs call it, so Python compiles it
    when it is called.
    """

    name: str
    group: str
    summary: str
    takes: str
    returns: str
    where: tuple[ArgumentKind, ...] = ()
    record: str = ""
    combine: str = ""
    of: tuple[str, ...] = ()
    details: str = ""
    raises: tuple[tuple[str, str], ...] = ()
    result: str = ""
    status: bool = False
    refuses: str = ""
    links_only: str = ""
    differentiated: bool = False
    more_joints_than: int = 0
    most_joints: int = 0
    needs: Needs = Needs.NOTHING
    absent: str = ""
    closed_loops: bool = True
    by_hand: bool = False
    on_demand: bool = False
    of_tip: bool = False
    tip: str = ""

    def at_tip(self, tip: str) -> ModelFunction:
        """The same function about the named ``tip``, called ``<tip>_<name>``."""
        return replace(self, name=f"{tip}_{self.name}", tip=tip, summary=about_tip(self.summary, tip))

    def suits(self, joints: int) -> bool:
        """Whether the function exists for robots with so many ``joints``."""
        return joints > self.more_joints_than and not 0 < self.most_joints < joints

    @cached_property
    def arguments(self) -> tuple[ArgumentKind, ...]:
        """The arguments in Python, in order."""
        known = QUANTITIES | {quantity.name: quantity for quantity in self.where}
        return tuple(known[name] for name in self.takes.split() if name != "*")

    @property
    def keywords(self) -> tuple[ArgumentKind, ...]:
        """Those among the arguments that are given by keyword."""
        names = self.takes.split()
        return self.arguments[names.index("*") :] if "*" in names else ()
