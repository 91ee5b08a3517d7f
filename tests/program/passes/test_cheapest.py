"""The choice between equivalent programs."""

from __future__ import annotations

from hypothesis import given

from program.passes.programs import ARITHMETIC, programs, recorded, same_values
from rrrgen.program.passes.cheapest import Cheapest, Choice, PassLog, Weights

cost = Weights()
cheapest = Cheapest()


@given(programs())
def test_the_choice_never_costs_more(program):
    log = PassLog()
    best, choice = cheapest([program], "random", log)
    assert cost(best)[0] <= cost(program)[0]
    assert choice.variant == 0
    assert same_values(program, best)
    for report in log.reports:
        assert report.function == "random"
        assert report.after.total <= report.before.total


@given(programs(ARITHMETIC), programs(ARITHMETIC))
def test_the_choice_takes_the_cheapest_way(one, two):
    trials = [Choice(0, None), Choice(1, None)]
    best, choice = cheapest([one, two], "random", PassLog(), trials)
    assert choice == trials[int(cost(two) < cost(one))]
    assert cost(best)[0] <= min(cost(one)[0], cost(two)[0])


def test_angles_weigh_more_than_operations():
    cheap = recorded(lambda b, q, dq, beta: [dq[0] * dq[1] * beta[0] * beta[1] + beta[2]])
    angle = recorded(lambda b, q, dq, beta: [b.sin(q[0])])
    assert cost(cheap) < cost(angle)


def test_the_weights_are_options():
    cheap = recorded(lambda b, q, dq, beta: [dq[0] * dq[1] * beta[0]])
    angle = recorded(lambda b, q, dq, beta: [b.sin(q[0])])
    free = Weights(sincos=0)
    assert free(angle) < free(cheap)
    _, choice = Cheapest(cost=free)([cheap, angle], "f", PassLog(), [Choice(0, None), Choice(1, None)])
    assert choice == Choice(1, None)
