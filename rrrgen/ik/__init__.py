"""Inverse kinematics: a chain is classified and its closed form recorded; backends print it, the runtime evaluates it.

:func:`rrrgen.ik.classify.plan` chooses the solver of a robot, with its number of solutions and its redundancy
parameter, or gives the reason why there is none. :mod:`rrrgen.ik.result_layout` defines the layout of the results.
"""
