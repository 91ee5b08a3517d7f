"""The benchmark: rrrgen's emitted C against the alternatives a user would choose.

Every contender gets the same states, compiler and flags, and all are measured in one run: ``make bench``.
"""
