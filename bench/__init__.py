"""The benchmark: rrrgen's emitted C side by side with what a user would pick instead.

Every contestant gets the same states and the same compiler with the same flags, in one run; ``make bench`` runs it.
"""
