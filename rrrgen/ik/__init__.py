"""Inverse kinematics: a chain is classified and its closed form recorded; backends print it, the runtime evaluates it.

:func:`rrrgen.ik.classify.plan` says what kind of solver a robot gets, how many solutions, which redundancy parameter,
and why none; :mod:`rrrgen.ik.answers` what an answer looks like.
"""
