"""The choice among laws by their losses on held-out windows, and what is said about the one chosen."""

from types import SimpleNamespace

import numpy as np
import pytest

from rrrgen.lab.friction.candidate_laws import candidates
from rrrgen.lab.friction.choice import LawScore, choose
from rrrgen.lab.friction.estimation import LawEstimate, notes, reported

BLOCKS = np.repeat(np.arange(10), 5)


def score(law, parameters, losses, bic=0.0):
    return LawScore(law, parameters, float(np.sqrt(np.mean(losses))), bic, losses)


def test_a_clear_gain_in_a_few_blocks_counts():
    even = np.ones(50)
    rough = even + 40.0 * (BLOCKS == 3) + 30.0 * (BLOCKS == 8)
    assert choose([score("simple", 6, rough), score("rich", 8, even)], BLOCKS) == 1


def test_a_small_uncertain_gain_does_not_pay_for_parameters():
    rng = np.random.default_rng(0)
    simple = 10.0 + rng.normal(size=50)
    rich = simple - 0.02 + rng.normal(size=50)
    assert choose([score("simple", 6, simple), score("rich", 8, rich, bic=-100.0)], BLOCKS) == 0


def test_of_equally_many_parameters_the_criterion_decides():
    even = np.ones(50)
    assert choose([score("a", 8, even, bic=5.0), score("b", 8, even, bic=-5.0)], BLOCKS) == 1


@pytest.mark.parametrize(
    ("gravity", "law", "theta", "held_out", "told"),
    [
        (
            2,
            1,
            [0.1, 1.0, 0.0, 0.2, 0.2, 0.7, 0.5, 0.0],
            1.0,
            ["of the measured torque of 0.1 with equal Coulomb"],
        ),
        (2, 1, [0.1, 1.0, 0.0, 0.2, 0.3, 0.7, 0.5, 0.0], 2.4, ["2.4 times the noise: asymmetric is the best"]),
        (1, 1, [0.1, 1.0, 0.2, 0.3, 0.7, 0.5, 0.0], 1.0, ["gravity is the force for which the two are equal"]),
        (0, 0, [0.1, 0.1, 0.2, 0.6, 0.0], 1.0, ["Coulomb friction of 0.7 forward and 0.5 backward (law asymmetric)"]),
        (0, 0, [0.1, 0.001, 0.2, 0.6, 0.0], 1.35, []),
        (0, 0, [0.1, 0.001, 0.2, 0.6, 0.0], 1.5, ["1.5 times the noise: something is left that coulomb_viscous does"]),
    ],
)
def test_models_that_are_the_same_and_a_poor_fit_are_named(gravity, law, theta, held_out, told):
    law, theta = candidates(gravity)[law], np.array(theta)
    values, rating = reported(law, theta, 1e-3), LawScore(law.name, len(theta), held_out, 0.0, np.ones(1))
    chosen = LawEstimate(law, law.settled(theta), values, dict.fromkeys(values, 1e-3), rating, values, 0.01)
    found = notes(chosen, SimpleNamespace(speed=1.0))
    assert [part in note for part, note in zip(told, found, strict=True)] == [True] * len(told), found
