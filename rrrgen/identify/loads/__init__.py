"""Experiments with a payload at the last link.

An unknown payload is estimated on an arm with known parameters; drive gains are estimated with a known payload.
"""
