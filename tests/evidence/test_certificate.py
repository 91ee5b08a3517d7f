"""The certificate: what it holds, that it is reproducible, and that tampering with any file is found."""

from __future__ import annotations

import json

from evidence.certified import content_of, run
from rrrgen.evidence import coding_rules
from rrrgen.evidence.certificate import CERTIFICATE, MARKDOWN, PAGE, VECTORS


def test_code_and_certificate_belong_together(certified):
    done = run("--check", certified)
    assert done.return_value == 0
    assert "code and certificate belong together" in done.output


def test_every_emitted_function_has_a_row(certified):
    content = content_of(certified)
    manifest = json.loads((certified / "manifest.json").read_text(encoding="utf-8"))
    assert set(manifest["functions"]) == set(content["functions"])
    for name, entry in content["functions"].items():
        rounding = entry["rounding"]
        if "none" in rounding:
            rows = [*content["skipped"], *content["without_bound"]]
            assert any(row["what"] == f"rounding of {name}" for row in rows)
            continue
        for precision in ("double", "float"):
            for port in manifest["functions"][name]["outputs"]:
                if "quantity" in rounding and port["name"] == "status":
                    continue  # the residual is that of the solution
                size = 1
                for extent in port["shape"]:
                    size *= extent
                assert len(rounding[precision]["bounds"][port["name"]]) == size


def test_sampled_errors_are_within_their_bounds(certified):
    for entry in content_of(certified)["functions"].values():
        for precision in ("double", "float"):
            if "none" not in entry["rounding"]:
                assert entry["rounding"][precision]["sampled"]["within"]


def test_the_equation_of_motion_is_traced_to_its_checks(certified):
    rows = {row["function"]: row for row in content_of(certified)["trace"]}
    assert rows["inverse_dynamics"]["equation"] == "(14.6)"
    assert "inverse_dynamics against Newton-Euler (built in)" in rows["inverse_dynamics"]["checks"]


def test_same_inputs_same_bytes(certified, tmp_path):
    run("pendulum", "-o", tmp_path / "again", "--samples", 20, "--no-casadi-files")
    for path in (CERTIFICATE, MARKDOWN, PAGE, VECTORS):
        assert (certified / path).read_bytes() == (tmp_path / "again" / path).read_bytes(), path


def test_libm_has_no_bound(tmp_path, monkeypatch):
    monkeypatch.setattr(coding_rules, "is_available", lambda: False)  # the other tests check the rules
    run("pendulum", "-o", tmp_path / "libm", "--samples", 5, "--trig", "libm", "--no-casadi-files")
    rounding = content_of(tmp_path / "libm")["functions"]["gravity"]["rounding"]
    assert "C library" in rounding["none"]
