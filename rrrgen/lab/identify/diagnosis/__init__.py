"""Diagnosis of a recording and a robot file: probable faults, their evidence, and what to write instead.

There is one rule per file, which states its thresholds and the reasons for them. A sound recording triggers none.
"""
