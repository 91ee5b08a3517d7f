"""Recorders of the positions and rates of the passive joints of closed loops, and of their status."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

from rrrgen.derive.functions.recording import FunctionBuilder, loop_port
from rrrgen.derive.recursions.linear_algebra import dot, flat
from rrrgen.derive.recursions.link_frames import Chain, program_loops
from rrrgen.derive.recursions.loops import NewtonLoops, SolvedLoops
from rrrgen.program import Failure, Port, Program, Status, Value
from rrrgen.robot.model import cosine_sine

DEAD_POINT = Failure(
    1, "near a dead point", "a closed loop is near a dead point", "the sine of the angle between two bars is below 1e-3"
)
NOT_ASSEMBLED = Failure(
    2,
    "not assembled",
    "a closed loop cannot be assembled",
    "the points that two bars join are too far apart or too near",
)


NOT_SOLVED = Failure(
    2,
    "not solved",
    "the closed loops are not solved",
    "a gap of a closed loop exceeds 1e-6 of the root of the summed squares of its lengths, or is not a number",
)
SOLVED = Fraction(1, 10**6)
"""Largest gap of a pin that counts as closed, over the root of the sum of the squared lengths of all loops."""

STEPS = 2
"""Steps of Newton's method: from a prediction by rates the first leaves an error below 1e-11 at 1 kHz and 5 rad/s."""


def solve_loops(r: FunctionBuilder) -> Program:
    """Record the positions loop_q (p,) at q by two steps of Newton's method, the largest gap left, and the status.

    The steps begin at a prediction, from the positions at ``q_last`` by the rates there.
    """
    b, q = r.builder, r.joints("q")
    q_last = r.take("q_last")
    last = list(b.input(loop_port(r, "loop_q_last", "positions of the passive joints at q_last")))
    before = program_loops(r.model, b, r.constant, [*q_last, *last])
    moved = [x - y for x, y in zip(q, q_last, strict=True)]
    positions = [x + dot(row, moved) for x, row in zip(last, before.W, strict=True)]
    for _ in range(STEPS):
        positions = program_loops(r.model, b, r.constant, [*q, *positions]).step()
    loops = program_loops(r.model, b, r.constant, [*q, *positions])
    sine = b.select(before.sine, loops.sine, b.neg(loops.sine))  # negative behind a dead point
    gap = _largest_gap(r, loops)
    ports = [
        (loop_port(r, "loop_q", "positions of the passive joints at q"), positions),
        (Port("gap", (), "m", "", "largest gap of a pin that is left, along an axis of its plane"), [gap]),
        (Port("status", (), "1"), [_newton_status(r, loops, sine, gap)]),
    ]
    failures = (replace(DEAD_POINT, meaning=f"{SINE_BELOW} it has at q_last"), NOT_SOLVED)
    return b.program(
        "solve_loops",
        ports,
        "Positions of the passive joints of closed loops, from those of the last call.",
        "loop_q = loop_q_last + W (q - q_last), then two steps loop_q -= inv(d gaps / d loop_q) gaps",
        ["The result counts where the status is 0; it is the loop_q of all other functions, and of the next call."],
        Status(len(ports) - 1, failures),
    )


SINE_BELOW = "the determinant of the loops, over the lengths of its columns, is below 1e-3 times the sign that"


def _newton_status(r: FunctionBuilder, loops: NewtonLoops, sine: Value, gap: Value) -> Value:
    """The status of loops with this relative determinant ``sine`` and this largest ``gap``, m."""
    b = r.builder
    closed = b.sub(b.mul(SOLVED, b.sqrt(loops.scale)), gap)
    code = b.select(b.sub(sine, Fraction(1, 1000)), 0, DEAD_POINT.code)
    return b.select(closed, code, NOT_SOLVED.code)


def _largest_gap(r: FunctionBuilder, loops: NewtonLoops) -> Value:
    b = r.builder
    least, *others = (b.neg(b.abs(gap)) for gap in loops.gaps)
    for other in others:
        least = b.min(least, other)
    return b.neg(least)


def loop_margins(r: FunctionBuilder) -> Program:
    """Record the squared sine between the bars of each loop (loops,): negative where it cannot be assembled."""
    b, loops = r.builder, r.chain().loops
    assert loops is not None
    margins = [b.div(dyad.discriminant, dyad.whole) for dyad in loops.dyads]
    port = Port("margin", (len(margins),), "1", "", "squared sine between the bars, negative for an open loop")
    return b.program("loop_margins", [(port, margins)], "How far closed loops are from their dead points.", "")


def closed_loops(r: FunctionBuilder) -> Program:
    """Record the passive joints (p, 2), W (p, n), the sines between the bars of each loop (loops,), and the status.

    A passive joint has the cosine and sine of its angle, a prismatic one its displacement (m) and 0.
    """
    b, chain = r.builder, r.chain()
    loops, spec = chain.loops, r.model.spec
    assert loops is not None
    assert spec.mechanism is not None
    passive = spec.mechanism.passive
    rates = [chain.joint_rates([int(j == k) for j in range(r.n)]) for k in range(r.n)]
    signs = [int(spec.mechanism.matrix[row][r.n + j]) for j, row in enumerate(passive)]
    W = [[sign * column[row] for column in rates] for sign, row in zip(signs, passive, strict=True)]
    if isinstance(loops, NewtonLoops):
        sine = b.abs(loops.sine)
        sines, code = [sine for _ in spec.loops], _newton_status(r, loops, sine, _largest_gap(r, loops))
    else:
        sines, code = _sines(r, loops)
    turning, sliding = (
        [spec.rows[row].name for row in passive if spec.rows[row].is_revolute is kind] for kind in (True, False)
    )
    described = f"cosine and sine of the displacements of {', '.join(turning)}"
    if sliding:
        described += f"; displacements of {', '.join(sliding)}, m, each with a 0"
    ports = [
        (
            Port("passive", (len(passive), 2), "SI" if sliding else "1", "", described),
            [v for sign, row in zip(signs, passive, strict=True) for v in _displacement(r, chain, row, sign)],
        ),
        (Port("W", (len(passive), r.n), "SI", "", "their rates are W dq"), flat(W)),
        (
            Port("sine", (len(sines),), "1", "", "of the angle between the two bars of each loop, 0 at a dead point"),
            sines,
        ),
        (Port("status", (), "1"), [code]),
    ]
    return b.program(
        "closed_loops",
        ports,
        "Passive joints of closed loops, and whether the loops can be assembled.",
        "rates of the passive joints = W(q) dq",
        ["All functions stay finite at dead points and beyond: a sine below 1e-6 counts as 1e-6."],
        Status(len(ports) - 1, (DEAD_POINT, NOT_SOLVED if spec.newton else NOT_ASSEMBLED)),
    )


def _sines(r: FunctionBuilder, loops: SolvedLoops) -> tuple[list[Value], Value]:
    """The sines between the bars of all dyads, in the order of the file, and their status."""
    b, sines, status = r.builder, [], [(dyad.margin, dyad.discriminant) for dyad in loops.dyads]
    for loop in r.model.spec.loops:
        dyad = next(candidate for candidate in loops.dyads if candidate.closure.name == loop.name)
        squared = b.div(dyad.discriminant, dyad.whole)
        sines.append(b.sqrt(b.select(squared, squared, 0)))
    margin, discriminant = status[0]
    for further in status[1:]:
        margin, discriminant = b.min(margin, further[0]), b.min(discriminant, further[1])
    return sines, b.select(margin, 0, b.select(discriminant, DEAD_POINT.code, NOT_ASSEMBLED.code))


def _displacement(r: FunctionBuilder, chain: Chain, i: int, sign: int) -> tuple[Any, Any]:
    """Cosine and sine of ``sign`` times the angle of joint ``i`` against the link before it, without theta.

    Of a prismatic joint, ``sign`` times its displacement, and 0.
    """
    joint, spec = chain.joints[i], r.model.spec
    if not joint.revolute:
        return sign * joint.slide, 0
    if spec.newton and spec.mechanism is not None:
        position = r.loop_positions()[spec.mechanism.passive.index(i)]
        return r.builder.cos(position), r.builder.sin(position)
    c, s = (r.constant(value) for value in cosine_sine(-r.model.joints[i].theta))
    c, s = joint.c * c - joint.s * s, joint.s * c + joint.c * s
    if joint.parallel:
        before = chain.joints[joint.parent]
        c, s = c * before.c + s * before.s, s * before.c - c * before.s
    return c, sign * s
