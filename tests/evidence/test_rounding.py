"""The rounding bounds: against exact arithmetic at random states, and attempts to break each of the four rules."""

from __future__ import annotations

import ctypes
import itertools
import math
import random
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles.random_robots import random_robot, to_yaml
from rrrgen.derive import derive_once
from rrrgen.evidence import rounding
from rrrgen.evidence.boxes import PortRange, Ranges, box_of, nominal_beta
from rrrgen.evidence.rounding import DOUBLE, FLOAT, LIBRARY_UNITS, NoBoundError, rounding_bounds
from rrrgen.evidence.sampling import errors_at, largest_errors
from rrrgen.evidence.vectors import exact_outputs
from rrrgen.program import Builder, Op, Port, evaluate
from rrrgen.program.program import Role
from rrrgen.robot.file import load_spec, loads_spec
from samples.draws import draws

SLACK = 1.001  # the wider format, in which errors are sampled, rounds too


def program_of(record, angles=2, values=4):
    """A program of ``angles`` joint angles and ``values`` rates, from a function of a builder and both lists."""
    builder = Builder()
    q = builder.input(Port("q", (angles,), role=Role.POSITION))
    x = builder.input(Port("x", (values,), role=Role.VELOCITY))
    outputs = record(builder, q, x)
    return builder.program("f", [(Port("y", (len(outputs),)), outputs)])


def unit_box(angles=2, values=4, reach=math.pi):
    return {"q": ([-reach] * angles, [reach] * angles), "x": ([-1.0] * values, [1.0] * values)}


# -- the rules -------------------------------------------------------------------------------------------------------


def enclosure(program, box):
    """The upper ends of the ranges of the outputs."""
    analysis = rounding._Analysis(program, box)
    ranges = rounding._Ranges()
    for index, node in enumerate(program.nodes):
        if node.op is Op.INPUT:
            low, high = analysis.box[index]
            ranges.append(node, (np.array([low]), np.array([high])))
        elif node.op is Op.CONST:
            ranges.append(node, rounding._constant(node.number)[0])
        else:
            ranges.append(node, ranges.exact(node))
    return [float(ranges.ranges[index][1][0]) for index in program.results[0]]


def rotations(builder, q, x):
    """Two rotations about two angles, and a cross product of rotated pairs."""
    s, c = [builder.sin(v) for v in q], [builder.cos(v) for v in q]
    a, b = c[0] * x[0] + s[0] * x[1], c[0] * x[1] - s[0] * x[0]
    d, e = c[1] * a + s[1] * b, c[1] * b - s[1] * a
    f, g = c[0] * x[2] + s[0] * x[3], c[0] * x[3] - s[0] * x[2]
    return [a, d, e, d * f + e * g, s[1] * (c[0] * x[2]) + x[0]]


def twice_the_angle(builder, q, x):
    """Rotations by twice an angle, by a second angle behind them, and products of their rows."""
    s, c = [builder.sin(v) for v in q], [builder.cos(v) for v in q]
    a, b = c[0] * x[0] + s[0] * x[1], c[0] * x[1] - s[0] * x[0]
    d, e = a * (c[0] + c[0]) - x[0], x[1] - b * (c[0] + c[0])
    f = (s[0] + s[0]) * a - x[1]
    return [d, f, c[1] * d + s[1] * e, c[1] * d - s[1] * f, d * e + x[2], d * x[2] + e * x[3]]


def vectors(builder, q, x):
    """A scalar product with the column of a rotation matrix, terms that cancel, and a sum of four products."""
    s, c = [builder.sin(v) for v in q], [builder.cos(v) for v in q]
    first, second, third = c[0], s[0] * c[1], s[0] * s[1]
    a, b = c[1] * x[0] + s[1] * x[1], c[1] * x[1] - s[1] * x[0]
    dot = first * x[0] + second * x[1] + third * x[2]
    cancelling = (a - x[2]) + (x[2] + (x[3] - a))
    return [dot, c[1] * first - s[1] * second, cancelling, first * a + second * x[2] + third * x[3] + a * b]


def no_rotations(builder, q, x):
    """What looks like rotations: other operands, another angle, a further term, twice the angle beside once."""
    s, c = [builder.sin(v) for v in q], [builder.cos(v) for v in q]
    a, b, f = c[0] * x[0] + s[0] * x[1], c[0] * x[1] - s[0] * x[0], c[0] * x[2] - s[0] * x[3]
    other_angle, further = (c[1] + c[1]) * a - x[0], (c[0] + c[0]) * (a + x[2]) - x[0]
    twice = (c[0] + c[0]) * a - x[0]
    long = s[0] * (x[0] * (x[1] + x[2]))
    return [a * x[1] + f * x[0], other_angle, further, twice * x[2] + b * x[3], c[1] * (c[0] * x[0]) - s[1] * long]


RECORDS = (rotations, twice_the_angle, vectors, no_rotations)


@pytest.mark.parametrize("record", RECORDS)
def test_rules_hold_at_random_states_and_near_the_worst(record):
    """Ranges are never left: 10^5 states, half of them with every rate at a corner, then a search uphill."""
    program, box = program_of(record), unit_box()
    rng = np.random.default_rng(1)
    q, x = rng.uniform(-np.pi, np.pi, (100_000, 2)), rng.uniform(-1, 1, (100_000, 4))
    x[::2] = np.sign(x[::2])
    (values,) = evaluate(program, q, x)
    upper = enclosure(program, box)
    for k, high in enumerate(upper):
        best = int(np.abs(values[:, k]).argmax())
        state = q[best], x[best]
        for step in range(60):
            trial_q = state[0] + rng.normal(0, 0.3 * 0.9**step, (200, 2))
            trial = evaluate(program, trial_q, np.clip(state[1] + rng.normal(0, 0.3 * 0.9**step, (200, 4)), -1, 1))[0]
            best = int(np.abs(trial[:, k]).argmax())
            assert np.abs(trial[best, k]) <= high
            state = trial_q[best], state[1]
        assert np.abs(values[:, k]).max() <= high


def test_each_rule_is_tight_where_it_should_be():
    """Rule 1: a rotated pair keeps its norm; rule 2: through a second rotation; rule 3: in a product of two pairs."""
    high = enclosure(program_of(rotations), unit_box())
    root = math.sqrt(2.0)
    assert high[:3] == pytest.approx([root] * 3, rel=1e-6)
    assert high[3] == pytest.approx(2.0, rel=1e-6)


def test_ranges_of_rotations_by_twice_the_angle_and_of_scalar_products_are_tight():
    """Rule 4, rule 3 for three products and for one of two sums, terms that cancel; intervals lose 1.2 to 4 here."""
    root = math.sqrt(2.0)
    high = enclosure(program_of(twice_the_angle), unit_box())
    assert high == pytest.approx([root, root, root, root, 2.0, 2.0], rel=1e-5)
    high = enclosure(program_of(vectors), unit_box())
    assert high[:3] == pytest.approx([math.sqrt(3.0), 1.0, 1.0], rel=1e-5)
    assert high[3] <= math.sqrt(2.0 + 2.0) + 1.0 + 1e-5


def test_without_the_rules_ranges_are_wider(monkeypatch):
    """Plain intervals lose a factor sqrt(2) per rotation: the test above can fail."""
    monkeypatch.setattr(rounding._Ranges, "reductions", lambda self, members: [])
    assert enclosure(program_of(rotations), unit_box())[:2] == pytest.approx([math.sqrt(2.0), 2.0], rel=1e-6)
    monkeypatch.setattr(rounding._Terms, "pairs", [])
    high = enclosure(program_of(rotations), unit_box())
    assert high[0] == pytest.approx(2.0)
    assert high[1] > 2.0 * math.sqrt(2.0)


def test_signs_that_make_no_rotation_are_not_taken_for_one():
    """c A + s B and c B + s A are no rotation: their norm reaches sqrt(2) times that of (A, B)."""

    def record(builder, q, x):
        s, c = builder.sin(q[0]), builder.cos(q[0])
        u, v = c * x[0] + s * x[1], c * x[1] + s * x[0]
        return [u * x[2] + v * x[3]]

    program = program_of(record)
    (high,) = enclosure(program, unit_box())
    assert high >= 2.0 * math.sqrt(2.0) - 1e-9  # reached at q = pi/4, x = 1


# -- errors carried forward ------------------------------------------------------------------------------------------


def nested_rotations(builder, q, x):
    """Rotations about two angles of products that are multiplied out, and a cross product of two rotated pairs."""
    s, c = [builder.sin(v) for v in q], [builder.cos(v) for v in q]
    t, r = c[1] * x[0], s[1] * x[0]
    a, b = c[0] * t + s[0] * x[1], c[0] * x[1] - s[0] * t
    d, e = s[0] * (s[1] * x[2]) + c[0] * x[3], c[0] * (s[1] * x[2]) - s[0] * x[3]
    return [a, b, r, a * e - b * d, a * b + x[3]]


ROUNDOFF = 2.0**-9


TRIGONOMETRIC = (Op.SIN, Op.COS)
KINDS = {
    "all": (*TRIGONOMETRIC, Op.ADD, Op.SUB, Op.MUL),
    "trigonometric": TRIGONOMETRIC,
    "sums": (Op.ADD, Op.SUB),
    "products": (Op.MUL,),
}


def erring(nodes, index, kinds):
    """Whether a node has an error: not inputs, constants and twice another node."""
    return nodes[index].op in kinds and not any(nodes[arg].op is Op.CONST for arg in nodes[index].args)


def with_large_errors(program, kinds, signs, q, x):
    """The outputs at q and x (states,) with errors ``signs * ROUNDOFF`` in all operations of these ``kinds``.

    Relative ones of sums and products, absolute ones of sines and cosines.
    """
    functions = {Op.ADD: np.add, Op.SUB: np.subtract, Op.MUL: np.multiply, Op.SIN: np.sin, Op.COS: np.cos}
    values = []
    for index, node in enumerate(program.nodes):
        if node.op is Op.INPUT:
            port, element = node.place
            exact = (q, x)[port][:, element]
        elif node.op is Op.CONST:
            exact = np.full(len(q), float(node.number))
        else:
            exact = functions[node.op](*(values[arg] for arg in node.args))
        scale = 1.0 if node.op in TRIGONOMETRIC else np.abs(exact)
        values.append(exact + (ROUNDOFF * signs[index] * scale if erring(program.nodes, index, kinds) else 0.0))
    return np.stack([values[index] for index in program.results[0]])


def worst_signs(program, kinds, rounds, measure):
    """The largest ``measure`` of the outputs at random states, every sign of an error for itself as it is worst."""
    rng = np.random.default_rng(1)
    worst = np.zeros(len(program.results[0]))
    for _ in range(rounds):
        q, x = rng.uniform(-np.pi, np.pi, (300, 2)), np.sign(rng.uniform(-1, 1, (300, 4)))
        q[::3] = np.round(q[::3] / (np.pi / 4.0)) * (np.pi / 4.0)
        exact = with_large_errors(program, (), [0.0] * len(program.nodes), q, x)
        for k in range(len(worst)):
            signs = np.sign(rng.uniform(-1, 1, (len(program.nodes), 300)))
            for index in range(len(signs)):
                if not erring(program.nodes, index, kinds):
                    continue
                kept = measure(with_large_errors(program, kinds, signs, q, x), exact)[k]
                signs[index] *= -1.0
                turned = measure(with_large_errors(program, kinds, signs, q, x), exact)[k]
                signs[index] *= np.where(turned > kept, 1.0, -1.0)
                worst[k] = max(worst[k], kept.max(), turned.max())
    return worst


@pytest.mark.parametrize("kinds", KINDS)
@pytest.mark.parametrize("record", [*RECORDS, nested_rotations])
def test_carried_errors_are_never_exceeded_and_nearly_reached(record, kinds, monkeypatch):
    """Errors so large that the worst signs of all roundings can be searched for: nothing exceeds its bound.

    Neither a difference from exact arithmetic nor, with the errors in it, a value; with errors of all kinds, and of
    one kind alone, which shows what the slack for the others would hide.
    """
    monkeypatch.setattr(rounding, "RHO", 1.0 + math.sqrt(2.0) * ROUNDOFF)
    monkeypatch.setattr(rounding, "_ROUNDOFF", np.full((2, 1), ROUNDOFF))
    program, box = program_of(record), unit_box()
    ranges, local = rounding._Ranges(), []
    for index, node in enumerate(program.nodes):
        radius = 0.0
        if node.op is Op.INPUT:
            low, high = (ends[node.place[1]] for ends in box["qx"[node.place[0]]])
            enclosure = np.array([low]), np.array([high])
        elif node.op is Op.CONST:
            enclosure = rounding._constant(node.number)[0]
        else:
            enclosure = ranges.exact(node)
            if erring(program.nodes, index, KINDS[kinds]):
                size = 1.0 if node.op in TRIGONOMETRIC else float(rounding._magnitude(enclosure)[0])
                radius = ROUNDOFF * size
        ranges.append(node, rounding._widen(enclosure, radius), radius)
        local.append(np.full((2, 1), radius))
    carried = rounding._Carried(ranges, local, {})
    bounds = np.array([carried.sizes[index][0, 0] for index in program.results[0]])
    largest = np.array([float(ranges.magnitude(index)[0]) for index in program.results[0]])
    rounds = 20 if kinds == "all" else 5
    worst = worst_signs(program, KINDS[kinds], rounds, lambda values, exact: np.abs(values - exact))
    assert (worst <= bounds * (1.0 + 1e-12) + 1e-14).all()  # doubles round too
    assert kinds != "all" or (worst >= 0.4 * bounds).all()
    assert (worst_signs(program, KINDS[kinds], 5, lambda values, exact: np.abs(values)) <= largest).all()


@pytest.mark.parametrize("robot", ["panda", "puma560"])
def test_the_third_axis_of_a_frame_is_bounded_as_the_others_are(robot):
    """It is emitted as the cross product of the other two: at most 15 times the errors found, not 40."""
    spec = load_spec(robot)
    program = derive_once(spec).programs["forward_kinematics"]
    box = box_of(program, spec, [], Ranges())
    bounds = rounding_bounds(program, {name: each.bounds for name, each in box.items()})
    errors = largest_errors(program, box, DOUBLE, 20_000, 1)
    assert (errors <= np.array(bounds.double[0]) * SLACK).all()
    assert max(bounds.double[0]) <= 15.0 * errors.max()


# -- bounds of whole programs ----------------------------------------------------------------------------------------


@st.composite
def programs(draw):
    """Random programs of rotated values: sums, products, constants of any denominator, angle sums, choices, tanh."""
    choices = draw(
        st.lists(st.tuples(st.integers(0, 9), st.integers(0, 10**6), st.integers(0, 10**6)), min_size=4, max_size=16)
    )
    constants = draw(st.lists(st.fractions(-3, 3, max_denominator=97), min_size=2, max_size=2))

    def record(builder, q, x):
        angle = q[0] + q[1]
        values = [*x, *(builder.sin(v) for v in (*q, angle)), *(builder.cos(v) for v in (*q, angle))]
        for kind, i, j in choices:
            a, b = values[i % len(values)], values[j % len(values)]
            c = values[(i + j) % len(values)]
            values.append(
                [
                    lambda a, b, c: a + b,
                    lambda a, b, c: a - b,
                    lambda a, b, c: a * b,
                    lambda a, b, c: constants[0] * a + constants[1] * b,
                    lambda a, b, c: builder.neg(a) + constants[1],
                    lambda a, b, c: builder.min(builder.abs(a), b),
                    lambda a, b, c: builder.select(a - b, a, b),
                    lambda a, b, c: clamp(builder, a, -1, 1) + limit(builder, b, Fraction(1, 3)),
                    lambda a, b, c: builder.select(a, b, c),
                    lambda a, b, c: builder.tanh(a) + builder.sign(b) * builder.exp(builder.min(c, 1)),
                ][kind](a, b, c)
            )
        return [builder.add(v, 0) for v in values[-3:]]

    return program_of(record)


@settings(max_examples=60, deadline=None)
@given(programs(), st.integers(0, 1000))
def test_random_programs_stay_within_their_bounds(program, seed):
    box = unit_box(reach=2.0)
    bounds = rounding_bounds(program, box, budget=1e5)
    rng = np.random.default_rng(seed)
    for precision, stated, kind in ((DOUBLE, bounds.double, np.float64), (FLOAT, bounds.single, np.float32)):
        states = [rng.uniform(-2, 2, (200, 2)).astype(kind), rng.uniform(-1, 1, (200, 4)).astype(kind)]
        states[1][::2] = np.sign(states[1][::2])
        errors = errors_at(program, states, precision, conditional=bounds.conditional)
        # the wider format rounds too: 2^-11 (2^-29) of the narrower one's errors, more where a bound is zero
        resolution = 1e-17 if precision is DOUBLE else 1e-13
        assert (errors.max(axis=1) <= np.array(stated[0]) * SLACK + resolution).all()


@pytest.fixture(scope="module")
def rrr():
    spec = load_spec("rrr")
    return spec, derive_once(spec)


def nominal_box(spec, model, program):
    return box_of(program, spec, [float(v) for v in model.beta_nominal], Ranges(speed=10.0, acceleration=60.0))


@pytest.mark.parametrize("function", ["forward_kinematics", "mass_matrix", "inverse_dynamics_nominal", "regressor"])
def test_functions_of_the_rrr_hold_and_are_not_loose(rrr, function):
    """The ratios of the reference robot: every straight-line function at most 8 times what a search finds."""
    spec, model = rrr
    program = model.programs[function]
    box = nominal_box(spec, model, program)
    bounds = rounding_bounds(program, {name: each.bounds for name, each in box.items()})
    for precision, stated in ((DOUBLE, bounds.double), (FLOAT, bounds.single)):
        flat = np.array(list(itertools.chain.from_iterable(stated)))
        errors = largest_errors(program, box, precision, 3000, 1)
        assert (errors <= flat * SLACK).all()
        assert flat.max() <= 8.0 * errors.max()


def test_a_constant_nearer_to_its_literal_than_the_wider_format_resolves_is_no_violation():
    """Its bound is its exact distance from the literal, here less than half of the spacing of long double."""
    constant = Fraction(0.3) + Fraction(16, 10**21)
    program = program_of(lambda b, q, x: [constant])
    bounds = rounding_bounds(program, unit_box())
    ranges = {name: PortRange(*map(tuple, ends), "test") for name, ends in unit_box().items()}
    assert bounds.double[0][0] == pytest.approx(1.6e-20)
    assert largest_errors(program, ranges, DOUBLE, 10, 1)[0] <= bounds.double[0][0] * SLACK


def test_bounds_hold_against_fifty_digits(rrr):
    """The compared values share no code with the analysis: mpmath against the compiled C."""
    import rrrgen

    spec, model = rrr
    program = model.programs["inverse_dynamics_nominal"]
    box = nominal_box(spec, model, program)
    bounds = rounding_bounds(program, {name: each.bounds for name, each in box.items()})
    compiled = rrrgen.compile("rrr")
    generator = random.Random(3)
    for _ in range(50):
        state = [
            [generator.uniform(*pair) for pair in zip(*box[port.name].bounds, strict=True)] for port in program.inputs
        ]
        (exact,) = exact_outputs(program, state)
        got = compiled.inverse_dynamics(*state)
        for value, reference, bound in zip(got.tolist(), exact, bounds.double[0], strict=True):
            assert abs(mpmath.mpf(value) - reference) <= bound


# -- choices ---------------------------------------------------------------------------------------------------------


def clamp(b, p, low, high):
    return b.select(p - high, high, b.select(low - p, low, p))


def limit(b, t, size):
    return b.select(b.abs(t) - size, b.sign(t) * size, t)


CONTINUOUS = {
    "larger": lambda b, p, m: b.select(p - m, p, m),
    "smaller": lambda b, p, m: b.select(p - m, m, p),
    "larger of a sum": lambda b, p, m: b.select(p + m, p, b.neg(m)),
    "positive part": lambda b, p, m: b.select(p, p, 0),
    "upper limit first": lambda b, p, m: clamp(b, p, Fraction(-1, 2), Fraction(1, 2)),
    "lower limit first": lambda b, p, m: b.select(Fraction(-1, 2) - p, Fraction(-1, 2), b.select(p - 1, 1, p)),
    "negated": lambda b, p, m: clamp(b, b.neg(p), Fraction(-1, 2), Fraction(1, 2)),
    "limit of a magnitude": lambda b, p, m: limit(b, p, Fraction(1, 2)),
    "limit of a magnitude that is computed": lambda b, p, m: limit(b, p, m * m + Fraction(1, 8)),
    "magnitude": lambda b, p, m: b.abs(p),
    "minimum": lambda b, p, m: b.min(p, m),
}
"""Functions of two values p and m that are continuous, written as a choice."""

OF_ONE = [name for name in CONTINUOUS if name not in ("larger", "smaller", "larger of a sum", "minimum")]

DISCONTINUOUS = {
    "other values": lambda b, p, m: b.select(p - m, 1, 2),
    "sign": lambda b, p, m: b.sign(p),
    "limits that may be exchanged": lambda b, p, m: clamp(b, p, m, Fraction(1, 2)),
    "limit of a magnitude that may be negative": lambda b, p, m: limit(b, p, m),
    "limit of a magnitude with the other sign": lambda b, p, m: b.select(b.abs(p) - 1, b.neg(b.sign(p)), p),
    "another limit than the compared one": lambda b, p, m: b.select(p - m, p, m + 1),
}


def chosen(choice):
    """A choice between a rotated value p, which rounds, and m, which does not."""
    return program_of(lambda b, q, x: [choice(b, b.cos(q[0]) * x[0] + b.sin(q[0]) * x[1], x[2])])


@pytest.mark.parametrize("name", CONTINUOUS)
def test_a_continuous_choice_has_a_bound_at_its_switch_too(name):
    """At random states, and at states whose compared values are as near to each other as numbers can be."""
    program = chosen(CONTINUOUS[name])
    bounds = rounding_bounds(program, unit_box())
    assert bounds.conditional == (False,)
    rng = np.random.default_rng(5)
    turned = 0
    for precision, stated, kind in ((DOUBLE, bounds.double, np.float64), (FLOAT, bounds.single, np.float32)):
        q, x = rng.uniform(-3, 3, (20_000, 2)).astype(kind), rng.uniform(-1, 1, (20_000, 4)).astype(kind)
        p = np.cos(q[:, 0]) * x[:, 0] + np.sin(q[:, 0]) * x[:, 1]
        x[::2, 2] = np.where(np.arange(10_000) % 4 < 2, p[::2], -p[::2])  # m = p but for rounding
        x[::4, 1] = -x[::4, 0] * (np.cos(q[::4, 0]) / np.sin(q[::4, 0]))  # p = 0 but for rounding
        x[1::4, 1] = (0.5 - x[1::4, 0] * np.cos(q[1::4, 0])) / np.sin(q[1::4, 0])  # p = 1/2
        states = [q, np.clip(x, -1, 1)]
        assert errors_at(program, states, precision).max() <= stated[0][0] * SLACK
        turned += (errors_at(program, states, precision, conditional=(True,)) == 0.0).sum()
    assert turned


@pytest.mark.parametrize("name", OF_ONE)
def test_a_limited_value_has_the_range_of_its_limits(name):
    (high,) = enclosure(chosen(CONTINUOUS[name]), unit_box())
    assert high <= (1.0 if name == "lower limit first" else 1.5)


@pytest.mark.parametrize("name", DISCONTINUOUS)
def test_a_choice_that_rounding_may_turn_over_is_conditional(name):
    assert rounding_bounds(chosen(DISCONTINUOUS[name]), unit_box()).conditional == (True,)


def test_a_comparison_without_rounding_or_that_never_changes_is_no_condition():
    free = [
        lambda b, q, x: [b.select(x[0], 1, 2)],
        lambda b, q, x: [b.sign(x[0])],
        lambda b, q, x: [b.select(b.cos(q[0]) + 2, x[0] * x[1], b.div(1, 3))],
        lambda b, q, x: [b.select(b.nonfinite(b.cos(q[0])), 0, x[0] * x[1])],
    ]
    for record in free:
        assert rounding_bounds(program_of(record), unit_box()).conditional == (False,)


def test_only_outputs_behind_a_comparison_are_conditional():
    b = Builder()
    x = b.input(Port("x", (2,)))
    product = x[0] * x[1]
    program = b.program("f", [(Port("a", ()), [product]), (Port("b", ()), [b.select(product, 1, 0)])])
    assert rounding_bounds(program, {"x": ([-1.0] * 2, [1.0] * 2)}).conditional == (False, True)


def test_the_library_is_assumed_for_tanh_and_exp_alone():
    record = [lambda b, q, x: [b.tanh(x[0] * x[1])], lambda b, q, x: [b.exp(x[0])], lambda b, q, x: [b.abs(x[0])]]
    assert [rounding_bounds(program_of(each), unit_box()).library for each in record] == [True, True, False]


@pytest.mark.parametrize("name", ["tanh", "exp"])
def test_the_c_library_of_this_machine_keeps_what_is_assumed_of_it(name):
    library = ctypes.CDLL(None)
    functions = [(getattr(library, name), ctypes.c_double, np.float64)]
    functions.append((getattr(library, f"{name}f"), ctypes.c_float, np.float32))
    generator = random.Random(2)
    for function, kind, narrow in functions:
        function.argtypes, function.restype = [kind], kind
        for _ in range(3000):
            x = float(narrow(generator.choice([-1, 1]) * 10 ** generator.uniform(-6, 1.5)))
            with mpmath.workdps(40):
                exact = getattr(mpmath, name)(mpmath.mpf(x))
                unit = mpmath.mpf(float(np.spacing(narrow(abs(float(exact))))))
                assert abs(mpmath.mpf(function(x)) - exact) <= LIBRARY_UNITS * unit


def test_a_divisor_of_many_magnitudes_keeps_its_sign():
    """x^2 in [1e-8, 100] is larger than the float's half unit of 100, which is 4e-6: its error is a share of it."""
    program = program_of(lambda b, q, x: [b.div(x[1], x[0] * x[0])])
    box = {**unit_box(), "x": ([1e-4, -1.0, 0.0, 0.0], [10.0, 1.0, 0.0, 0.0])}
    bounds = rounding_bounds(program, box)
    ranges = {name: PortRange(*map(tuple, ends), "test") for name, ends in box.items()}
    for precision, stated in ((DOUBLE, bounds.double), (FLOAT, bounds.single)):
        assert largest_errors(program, ranges, precision, 2000, 1).max() <= stated[0][0]


FURTHER = ("points", "control", "observer", "timing", "trajectory", "hessian")


def held(model, names, samples, budget=1e5):
    """Assert that errors found at random states and in a search stay within the bounds; returns what has a bound."""
    found = {}
    for name in names:
        program = model.programs[name]
        box = box_of(program, model.spec, nominal_beta(model), Ranges())
        try:
            bounds = rounding_bounds(program, {port: each.bounds for port, each in box.items()}, budget)
        except NoBoundError:
            continue
        found[name] = bounds
        for precision, stated in ((DOUBLE, bounds.double), (FLOAT, bounds.single)):
            flat = np.array(list(itertools.chain.from_iterable(stated)))
            errors = largest_errors(program, box, precision, samples, 7, conditional=bounds.conditional)
            assert (errors <= flat * SLACK).all(), name
    return found


@pytest.fixture(scope="module")
def further():
    return derive_once(load_spec("rrr"), ("model", *FURTHER))


LAWS = ("pd_gravity", "feedforward", "computed_torque", "slotine_li", "impedance", "momentum_observer", "contact")


def test_laws_and_observers_of_the_rrr_hold_and_torques_without_a_condition(further):
    found = held(further, LAWS, 1000)
    assert set(found) == set(LAWS)
    for name, bounds in found.items():
        ports = further.programs[name].outputs
        conditional = {port.name for port, each in zip(ports, bounds.conditional, strict=True) if each}
        assert conditional <= {"z_next", "beta_next", "touches"}, name
        assert bounds.library == any(node.op in (Op.TANH, Op.EXP) for node in further.programs[name].nodes)


@pytest.mark.sweep(but=["point_jacobian", "quintic", "forward_dynamics_derivatives_nominal"])
@pytest.mark.parametrize(
    "name",
    [
        *("point_jacobian", "point_motion", "wrench_torques", "tool_kinematics", "tool_target", "path_dynamics"),
        *("quintic", "smooth_friction", "inverse_dynamics_hessian_product", "forward_dynamics_derivatives_nominal"),
    ],
)
def test_points_tools_motions_and_derivatives_of_the_rrr_hold(further, name):
    assert held(further, [name], 1000, budget=1e6)


@pytest.mark.sweep
@pytest.mark.parametrize("seed", range(draws(3)))
def test_functions_of_arms_drawn_at_random_hold(seed):
    """With friction, slides and tools as they come; every function that has a bound."""
    spec = loads_spec(to_yaml(random_robot(4000 + seed, n=2 + seed % 3)))
    model = derive_once(spec, ("model", *FURTHER))
    assert len(held(model, model.programs, 300)) > 40


# -- where there is no bound -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("record", "reason"),
    [
        (lambda b, q, x: [b.div(1, x[0])], "divisor"),
        (lambda b, q, x: [b.sqrt(x[0])], "square root"),
        (lambda b, q, x: [b.sin(x[0] * x[1])], "not linear"),
    ],
)
def test_no_bound_without_a_rule(record, reason):
    with pytest.raises(NoBoundError, match=reason):
        rounding_bounds(program_of(record), unit_box())


def test_no_bound_outside_the_kernels_range():
    with pytest.raises(NoBoundError, match="beyond 2000 rad"):
        rounding_bounds(program_of(lambda b, q, x: [b.sin(q[0])]), unit_box(reach=3000.0))


def test_constants_count_with_their_literals():
    program = program_of(lambda b, q, x: [b.add(b.mul(x[0], 0), Fraction(1, 3)), x[1]])
    bounds = rounding_bounds(program, unit_box())
    assert bounds.double[0][0] == pytest.approx(abs(float(Fraction(1, 3) - Fraction(1 / 3))), rel=1e-6)
    assert bounds.double[0][1] == 0.0


def test_a_product_with_a_power_of_two_is_exact():
    program = program_of(lambda b, q, x: [b.mul(4, x[0])])
    assert rounding_bounds(program, unit_box()).double[0][0] < 1e-300


def test_sums_of_angles_round():
    """sin(q1 + q2) has the rounding of the sum beside the kernel's error."""
    alone = rounding_bounds(program_of(lambda b, q, x: [b.sin(q[0])]), unit_box())
    both = rounding_bounds(program_of(lambda b, q, x: [b.sin(q[0] + q[1])]), unit_box())
    assert both.double[0][0] > alone.double[0][0] + 4e-16


def test_an_input_without_a_range_has_no_bound():
    with pytest.raises(NoBoundError, match="x has no range"):
        rounding_bounds(program_of(lambda b, q, x: [x[0] + x[1]]), {"q": unit_box()["q"]})
