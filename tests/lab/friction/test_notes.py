"""What is said about bristles that the recording cannot tell from rigid contact."""

from types import SimpleNamespace

import numpy as np

from rrrgen.lab.friction.estimation import notes, stiff_bristles


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


def told_about(sigma0, excess, resolution):
    """Notes on LuGre friction that is otherwise well determined."""
    values = {"inertia": 0.07, "coulomb": 0.6, "viscous": 0.1, "sigma0": sigma0, "sigma1": 20.0}
    values |= {"stiction_excess": excess, "stribeck_speed": 0.1}
    chosen = law("lugre", 0.9)
    chosen.values, chosen.std = values, {name: 0.01 * abs(value) for name, value in values.items()}
    chosen.torque_error, chosen.break_away = 0.01, 0.9
    motion = np.full((3, 5000), 0.05)
    data = SimpleNamespace(sliding=np.ones(5000, bool), motion=motion, period=1e-3, speed=1.0, resolution=resolution)
    return notes(chosen, data)


def test_bristles_below_the_resolution_of_the_encoder_are_told():
    assert told_about(2e4, 0.3, 1e-5) == ()  # they bend by 4.5 steps
    (told,) = told_about(1.8e4, 0.3, 1e-4)
    assert "0.5 encoder steps" in told
    assert "lower bounds" in told


def test_a_negative_level_at_rest_is_told():
    (told,) = told_about(2e4, -0.7, 1e-5)
    assert "-0.1" in told
    assert "robot file" in told
