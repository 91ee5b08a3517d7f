"""The text of a program: complete, and the same every time."""

from __future__ import annotations

from fractions import Fraction

from rrrgen.program import Builder, Port, Program, Role, Status


def example() -> Program:
    """One of every kind of line: inputs of all shapes, constants short and long, a label, a choice, a status."""
    b = Builder()
    q = b.input(Port("q", (2,), "rad", "joint", "joint positions", Role.POSITION))
    k = b.input(Port("k", (), role=Role.FRICTION))[0]
    s12 = b.label(b.sin(q[0] + q[1]), "s12")
    outputs = [
        (Port("y", (1, 2), "N m", "", "torques"), [Fraction(9, 8) * s12 - k, s12 / (k * k)]),
        (Port("code", ()), [b.select(k, 0, 1)]),
        (Port("none", (0,)), []),
        (Port("v", (2,), "rad/s", role=Role.VELOCITY), [-q[0], Fraction(31415926535897932, 10**16) + k]),
    ]
    status = Status.of(1, "too cold", "the oil is too cold", "k is not positive")
    return b.program("example", outputs, "Everything at once.", "y = ...\nv = ...", status=status)


TEXT = """\
example: Everything at once.
  y = ...
  v = ...
  in      q     (2)     rad    position             joint, joint positions
  in      k     ()      -      friction parameters
  out     y     (1, 2)  N m    other                torques
  status  code  ()      -      other                0, or 1 where k is not positive
  out     none  (0)     -      other
  out     v     (2)     rad/s  velocity
  %1 = q[0] + q[1]
  %2 = sin(%1)  # s12
  %3 = (9/8)*%2
  %4 = %3 - k
  %5 = k*k
  %6 = %2/%5
  %7 = k > 0 ? 0 : 1
  %8 = -q[0]
  %9 = k + (~3.1415926535897931)
  y = %4, %6
  code = %7
  none =
  v = %8, %9
  operations: 2 mul, 3 add, 1 div, 1 sincos, 1 neg, 1 other
"""


def test_everything_is_written():
    assert example().dump() == TEXT.replace("~3.1415926535897931", f"~{31415926535897932 / 10**16!r}")


def test_long_results_are_broken():
    b = Builder()
    x = b.input(Port("x", (60,)))
    lines = b.program("f", [(Port("y", (60,)), x[::-1])]).dump().splitlines()
    assert max(map(len, lines)) <= 102
    assert "".join(line.strip() + " " for line in lines[3:-1]).strip() == "y = " + ", ".join(
        f"x[{k}]" for k in reversed(range(60))
    )
