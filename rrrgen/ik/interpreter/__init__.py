"""Evaluates an inverse kinematics solver in Python: the reference for the emitted C, and used without a compiler.

The solver was recorded as a sequence of operations with choices between roots ("the record"); C is printed from the
same record. Both sides share the record, the tolerances and the rules by which a candidate counts as a solution, and
compute every number in their own way, see :mod:`rrrgen.ik.interpreter.solve`.
"""
