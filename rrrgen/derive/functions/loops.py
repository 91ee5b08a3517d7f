"""Recorder of the positions and rates of the passive joints of closed loops, and of their status."""

from __future__ import annotations

from typing import Any

from rrrgen.derive.functions.recording import Recording
from rrrgen.derive.recursions.linear_algebra import flat
from rrrgen.derive.recursions.link_frames import Chain
from rrrgen.program import Failure, Port, Program, Status
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


def loop_margins(r: Recording) -> Program:
    """Record the squared sine between the bars of each loop (loops,): negative where it cannot be assembled."""
    b, loops = r.builder, r.chain().loops
    assert loops is not None
    margins = [b.div(dyad.discriminant, dyad.whole) for dyad in loops.dyads]
    port = Port("margin", (len(margins),), "1", "", "squared sine between the bars, negative for an open loop")
    return b.program("loop_margins", [(port, margins)], "How far closed loops are from their dead points.", "")


def closed_loops(r: Recording) -> Program:
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
    sines, status = [], [(dyad.margin, dyad.discriminant) for dyad in loops.dyads]
    for loop in spec.loops:
        dyad = next(each for each in loops.dyads if each.closure.name == loop.name)
        squared = b.div(dyad.discriminant, dyad.whole)
        sines.append(b.sqrt(b.select(squared, squared, 0)))
    margin, discriminant = status[0]
    for further in status[1:]:
        margin, discriminant = b.min(margin, further[0]), b.min(discriminant, further[1])
    code = b.select(margin, 0, b.select(discriminant, DEAD_POINT.code, NOT_ASSEMBLED.code))
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
        Status(len(ports) - 1, (DEAD_POINT, NOT_ASSEMBLED)),
    )


def _displacement(r: Recording, chain: Chain, i: int, sign: int) -> tuple[Any, Any]:
    """Cosine and sine of ``sign`` times the angle of joint ``i`` against the link before it, without theta.

    Of a prismatic joint, ``sign`` times its displacement, and 0.
    """
    joint = chain.joints[i]
    if not joint.revolute:
        return sign * joint.slide, 0
    c, s = (r.constant(value) for value in cosine_sine(-r.model.joints[i].theta))
    c, s = joint.c * c - joint.s * s, joint.s * c + joint.c * s
    if joint.parallel:
        before = chain.joints[joint.parent]
        c, s = c * before.c + s * before.s, s * before.c - c * before.s
    return c, sign * s
