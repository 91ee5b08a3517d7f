"""The choice among laws by their losses on held-out windows."""

import numpy as np

from rrrgen.friction_estimation.selection import Score, choose

BLOCKS = np.repeat(np.arange(10), 5)


def score(law, parameters, losses, bic=0.0):
    return Score(law, parameters, float(np.sqrt(np.mean(losses))), bic, losses)


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
