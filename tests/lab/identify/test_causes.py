"""Causes of what a diagnosis finds: one gathers the evidence of all rules."""

from rrrgen.lab.identify.diagnosis.causes import Cause, merge_causes


def test_one_cause_gathers_the_evidence_of_all_rules():
    either = Cause("x or y", "", ("3",), either=("x", "y"))
    found = merge_causes([Cause("x", "do", ("1",)), Cause("x", "do", ("2",)), either, Cause("vague", "", general=True)])
    assert [(each.cause, each.evidence) for each in found] == [("x", ("1", "2", "3"))]
    assert [each.cause for each in merge_causes([Cause("vague", "", general=True)])] == ["vague"]
