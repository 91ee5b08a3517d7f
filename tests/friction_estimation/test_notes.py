"""What is said about bristles that the recording cannot tell from rigid contact."""

from types import SimpleNamespace

from rrrgen.friction_estimation.notes import stiff_bristles


def law(name, held_out, sigma0=0.0, std=0.0):
    score = SimpleNamespace(held_out=held_out)
    return SimpleNamespace(name=name, score=score, values={"sigma0": sigma0}, std={"sigma0": std})


def test_a_tie_gives_a_lower_bound_of_the_stiffness():
    chosen = law("stribeck", 0.9)
    (told,) = stiff_bristles(chosen, (chosen, law("lugre", 0.91, 1e5, 2e4)), 4e5)
    assert "lower bound" in told
    assert told.endswith("about 5.5e+04")  # 1e5 e^-0.6
    (told,) = stiff_bristles(chosen, (chosen, law("lugre", 0.9, 1e8, 1e3)), 4e5)
    assert told.endswith("about 4e+05")  # what the sampling rate resolves


def test_bristles_that_are_told_need_no_bound():
    rigid = law("stribeck", 0.9)
    assert stiff_bristles(rigid, (rigid, law("lugre", 1.5, 1e5, 2e4)), 4e5) == ()
    bent = law("lugre", 0.9, 1e5, 2e4)
    assert stiff_bristles(bent, (rigid, bent), 4e5) == ()
