"""Held-out scores: folds, blocked cross-validation, validation of a part, and the band of the predicted torque."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import rrrgen
from lab.identify.held_out_recording import LOGGED, NOISE, TERMS, recording
from rrrgen.base.errors import InputError
from rrrgen.cli.main import run as rrrgen_run
from rrrgen.lab.identify.cross_validation import cross_validate
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.lab.identify.results import as_record, identified_spec
from rrrgen.lab.identify.scores import Coverage, TorqueBand, held_out_notes, joint_table
from rrrgen.lab.identify.validation import column_model, validate_recordings
from rrrgen.robot.file import dumps
from rrrgen.runtime import load
from samples.recordings import write_log


@pytest.fixture(scope="module")
def arm():
    return rrrgen.compile("planar2r", backend="numpy")


def test_folds_hold_out_every_instant_once():
    t = np.linspace(2.0, 12.0, 501)
    folds = [Split.parse(f"fold:{k}/4").with_guard(0.2) for k in range(1, 5)]
    scored = np.array([fold.is_scored(t, 2.0, 10.0) for fold in folds])
    fitted = np.array([fold.is_fitted(t, 2.0, 10.0) for fold in folds])
    assert not np.any(scored & fitted)
    assert np.all(np.sum(scored, axis=0) <= 1)
    assert np.mean(scored.any(axis=0)) > 0.85
    assert scored[0, 0]
    assert scored[3, -1]
    assert t[scored[1]].min() == pytest.approx(2.0 + 2.5 + 0.2, abs=0.03)
    assert str(folds[1]).startswith("fitted without part 2 of 4, scored on it")
    for text in ("fold:0/4", "fold:5/4", "fold:1/1", "fold:1", "fold:a/b"):
        with pytest.raises(InputError):
            Split.parse(text)


def test_the_band_holds_95_percent_of_torques_that_were_not_fitted(arm):
    """White noise of known size; few rows, so that the parameters matter."""
    inside, own = [], []
    for seed in range(6):
        log = recording(arm, seed)
        found = identify(arm, [log], LOGGED, Options(terms=TERMS, split=Split.parse("first:0.1"), guard=0.0, poses=2))
        covered = found.band.coverage(found.held_out_blocks)
        inside.append(covered.share)
        own.append(covered.parameters)
        assert np.mean(covered.joints) == pytest.approx(covered.share)
        assert held_out_notes(found.scores, covered, log.joints) == ()
        assert found.band.sigma == pytest.approx(NOISE, rel=0.15)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)
    assert min(own) > 0.1
    narrow = TorqueBand(found.band.theta, found.band.root, 0.5 * found.band.sigma)
    assert narrow.coverage(found.held_out_blocks).share < 0.85


def test_a_joint_that_changes_after_the_fit_is_named(arm):
    """Its torque counts little in the total error; a small change shows in the band alone."""
    log = recording(arm, wrong=3.0)
    options = Options(terms=TERMS, split=Split.parse("first:0.7"), consistent=False, poses=2)
    found = identify(arm, [log], LOGGED, options)
    (changed,) = held_out_notes(found.scores, found.band.coverage(found.held_out_blocks), log.joints)
    assert "torque of q2 is not explained where it was not fitted" in changed
    told = held_out_notes(found.scores, Coverage(0.9, 0.1, (0.8, 0.95)), log.joints)
    assert "too few held-out rows of q1 (80 %)" in told[1]


def test_what_noise_does_not_explain_is_said_at_every_held_out_error(arm):
    """A ripple over position, twice the noise, at q2 alone: fit, cross-validation and validation say it."""
    log = recording(arm)
    ripple = 2.0 * np.sqrt(2.0) * NOISE[1] * np.sin(3.0 * log.q[:, 1])
    rippled = replace(log, tau=log.tau + np.outer(ripple, [0.0, 1.0]))
    options = Options(terms=TERMS, consistent=False, poses=2)
    for given, joints in ((log, []), (rippled, ["q2"])):
        found = identify(arm, [given], LOGGED, replace(options, split=Split.parse("blocks:1")))
        left = found.left_in(given.joints)
        assert [each.name for each in left if each.is_left] == joints
        assert all(each.growth == pytest.approx(1.0, abs=0.15) for each in left)
        crossed = cross_validate(arm, [given], LOGGED, options, 3)
        assert [each.name for each in crossed.left if each.is_left] == joints
        assert any("noise does not explain" in line for line in crossed.lines()) == bool(joints)
        assert [each["name"] for each in crossed.to_json()["remainder"] if each["is_left"]] == joints
        model = column_model(found.regressor, found.theta)
        scored = validate_recordings(model, [given], LOGGED, label="held-out data")
        assert [each.name for each in scored.left if each.is_left] == joints
        assert scored.to_json()["held_out_notes"] == list(scored.notes)
        assert len(scored.notes) == len(joints)
        assert validate_recordings(model, [given], LOGGED, label="its own data").left == ()
    record = as_record(found, rippled.joints)
    (note,) = record["held_out_notes"]
    assert note.startswith("noise does not explain the held-out torque errors of q2 (")
    assert "ripple over position" in note
    assert record["held_out_remainder"][1]["predictable"] > 0.2
    whole = identify(arm, [rippled], LOGGED, options)
    assert whole.left_in(rippled.joints) == ()


def test_scores_by_joint(arm):
    log = recording(arm)
    found = identify(
        arm, [log], LOGGED, Options(terms=TERMS, split=Split.parse("first:0.5"), consistent=False, poses=2)
    )
    held_out = next(score for score in found.scores if score.data == "held out")
    use = found.split.is_scored(log.t, *log.span)
    size = np.sqrt(np.mean(log.tau[use] ** 2, axis=0))
    assert held_out.joint_relative == pytest.approx(NOISE / size, rel=0.1)
    lines = joint_table(found.scores, log.joints)
    assert lines[0].split() == ["by", "joint", "q1", "q2"]
    assert lines[2].startswith("held out, weighted")
    assert f"{100 * held_out.joint_relative[1]:.3g} %" in lines[2]


@pytest.mark.sweep
def test_the_commands(tmp_path, arm, monkeypatch, capsys):
    """identify --cross-validate prints the table; validate --split scores the part that was not fitted, and says so."""
    from functools import partial

    monkeypatch.setattr(load, "compile", partial(load.compile, backend="numpy"))
    log = recording(arm, samples=1000)
    robot, data = tmp_path / "robot.yaml", tmp_path / "log.csv"
    start = identify(arm, [log], LOGGED, Options(terms=TERMS, poses=2)).consistent
    robot.write_text(dumps(identified_spec(arm.spec, start)))
    write_log(data, log)

    def run(*words):
        code = rrrgen_run([words[0], *map(str, words[1:]), "--log", str(data), "--cutoff", "20"])
        return code, capsys.readouterr().out

    code, text = run("identify", robot, "--cross-validate", 4, "-o", tmp_path / "cv")
    assert code == 0, text
    assert "cross-validation, 4 parts" in text
    assert "95 % band of the predicted torque: covers" in text
    assert len(json.loads((tmp_path / "cv" / "results" / "cross_validation.json").read_text())["parts"]) == 4
    assert run("identify", robot, "--cross-validate", 4, "--split", "first:0.5", "-o", tmp_path / "no")[0] == 2
    assert run("identify", robot, "--split", "first:0.5", "-o", tmp_path / "half")[0] == 0
    fitted = tmp_path / "half" / "results" / "robot.yaml"
    code, text = run(
        "experiment", "validate", fitted, "--split", "first:0.5", "--require-held-out", "-o", tmp_path / "v1"
    )
    assert code == 0, text
    assert "scored on held-out data" in text
    record = json.loads((tmp_path / "half" / "results" / "identification.json").read_text())
    scored = json.loads((tmp_path / "v1" / "results" / "validation.json").read_text())
    own = [each for each in record["scores"] if (each["data"], each["estimate"]) == ("held out", "consistent")]
    assert scored["scores"][0]["relative_error"] == pytest.approx(own[0]["relative_error"], rel=0.02)
    code, text = run("experiment", "validate", fitted, "--require-held-out", "-o", tmp_path / "v2")
    assert code == 1, text
    assert run("experiment", "validate", fitted, "--split", "last:0.5", "-o", tmp_path / "v3")[0] in (2, 3)
