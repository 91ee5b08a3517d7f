"""Experiments with a load at the last link: an unknown payload on a known arm, a known one for unknown drive gains."""
