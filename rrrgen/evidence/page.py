"""The certificate as a page that an assessor reads, in Markdown and as one HTML file."""

from __future__ import annotations

import html as markup
from collections.abc import Mapping, Sequence
from typing import Any

Row = Sequence[str]


def _blocks(content: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """The page as blocks: ("title" | "heading" | "text", text), ("list", items) or ("table", rows with a heading)."""
    report = content["verification"]
    blocks: list[tuple[str, Any]] = [
        ("title", f"Certificate of {content['robot']}"),
        (
            "text",
            f"Written by {content['tool']} for the model {content['model_hash']}, C code in {content['real']}. "
            f"Digest of this certificate: {content['digest']}. `rrrgen certify --check DIR` compares it with the "
            "files beside it.",
        ),
        ("heading", "Proven"),
        (
            "text",
            "Bounds of the rounding error of every function: the largest difference between the emitted arithmetic and "
            "exact arithmetic at the same inputs, for all inputs in the box; sines, cosines and constants included. "
            "The table has the worst element of each function; certificate.json has one bound per element and the "
            "box. For forward dynamics and its derivatives residuals such as M ddq - (tau - c - g) are bounded, where "
            "the status is ok and results lie in the box. The ratio sets the bound beside the largest error that was "
            "found by sampling and search.",
        ),
        ("table", _rounding_rows(content)),
        ("text", _kernel_text(content)),
        ("heading", "Tested"),
    ]
    if report is None:
        blocks.append(("text", "The comparison with independent dynamics was not asked for."))
    else:
        verdict = "All comparisons pass" if report["ok"] else "Some comparisons FAIL"
        blocks += [
            ("text", f"{verdict}, at {report['samples']} random states, seed {report['seed']}."),
            ("table", _verification_rows(report)),
        ]
    for name, title in TOOL_SECTIONS:
        if name in content:
            blocks += [("heading", title), *_tool_blocks(content[name])]
    blocks += [
        ("heading", "From equation to test"),
        ("table", [("equation", "function", "checks"), *_trace_rows(content)]),
        *_without_bound_blocks(content["without_bound"]),
        *_inapplicable_blocks(content.get("not_applicable", ())),
        ("heading", "Not covered"),
        ("table", [("what", "reason"), *((row["what"], row["reason"]) for row in content["skipped"])]),
        ("text", "This certificate does not claim:"),
        ("list", content["not_claimed"]),
        ("heading", "Files"),
        ("table", [("file", "SHA-256"), *content["files"].items(), *content["evidence"].items()]),
    ]
    return blocks


def _without_bound_blocks(rows: Sequence[Mapping[str, str]]) -> list[tuple[str, Any]]:
    if not rows:
        return []
    return [
        ("heading", "Without a bound, tested instead"),
        ("text", "Nothing is proven about the errors of these; the figures are what was found, no largest values."),
        (
            "table",
            [("what", "why it has no bound", "in its place"), *((r["what"], r["reason"], r["instead"]) for r in rows)],
        ),
    ]


def _inapplicable_blocks(rows: Sequence[Mapping[str, str]]) -> list[tuple[str, Any]]:
    if not rows:
        return []
    return [
        ("heading", "Not applicable"),
        ("table", [("what", "reason"), *((row["what"], row["reason"]) for row in rows)]),
    ]


TOOL_SECTIONS = (
    ("run_time_errors", "Run-time errors"),
    ("coding_rules", "Coding rules"),
    ("instructions", "Counted instructions"),
)
"""The entries of external tools in the certificate, with their headings."""


def _tool_blocks(entry: Mapping[str, Any]) -> list[tuple[str, Any]]:
    blocks: list[tuple[str, Any]] = [("text", entry["summary"])]
    if entry.get("rows"):
        headings = tuple(entry["headings"])
        blocks.append(("table", [headings, *(tuple(str(cell) for cell in row) for row in entry["rows"])]))
    return blocks


def _rounding_rows(content: Mapping[str, Any]) -> list[Row]:
    rows: list[Row] = [("function", "double", "ratio", "float", "ratio", "condition")]
    for name, entry in content["functions"].items():
        rounding = entry["rounding"]
        if "none" in rounding:
            rows.append((name, "none", "", "none", "", rounding["none"]))
            continue
        cells = [f"{name}, residual" if "quantity" in rounding else name]
        for precision in ("double", "float"):
            stated = rounding[precision]
            ratio = stated.get("sampled", {}).get("ratio")
            cells += [f"{stated['worst']:.2e}", "" if ratio is None else f"{ratio:.3g}"]
        conditions = []
        if "conditional" in rounding:
            names = ", ".join(rounding["conditional"]["outputs"])
            conditions.append(f"{names}: where comparisons come out as in exact arithmetic")
        least = rounding.get("double", {}).get("least_diagonal_of_M")
        if least is not None:
            single = rounding["float"]["least_diagonal_of_M"]
            conditions.append(f"no diagonal entry of M is below {least:.2g} (float: {single:.2g})")
        if "assumption" in rounding:
            conditions.append(rounding["assumption"])
        rows.append((*cells, "; ".join(conditions)))
    return rows


def _kernel_text(content: Mapping[str, Any]) -> str:
    parts = [
        f"{value['absolute_error']:g} in {name} for angles up to {value['range_rad']:g} rad"
        for name, value in content["kernel"].items()
    ]
    return f"Absolute error of the kernel of sine and cosine: {', '.join(parts)}."


def _verification_rows(report: Mapping[str, Any]) -> list[Row]:
    rows: list[Row] = [("function", "reference", "parameters", "largest relative difference", "tolerance", "verdict")]
    for row in report["rows"]:
        difference = row["max_relative_difference"]
        shown = "none" if difference is None else f"{difference:.1e}"
        tolerance = f"{row['tolerance']:.0e}" if row["tolerance"] else "0"
        rows.append((row["function"], row["reference"], row["parameters"], shown, tolerance, row["verdict"]))
    return rows


def _trace_rows(content: Mapping[str, Any]) -> list[Row]:
    return [(row["equation"], row["function"], "; ".join(row["checks"]) or "none") for row in content["trace"]]


def markdown(content: Mapping[str, Any]) -> str:
    """The certificate as a page in Markdown."""
    lines: list[str] = []
    for kind, value in _blocks(content):
        if kind == "title":
            lines += [f"# {value}", ""]
        elif kind == "heading":
            lines += [f"## {value}", ""]
        elif kind == "text":
            lines += [value, ""]
        elif kind == "list":
            lines += [*(f"- {item}" for item in value), ""]
        else:
            heading, *rows = value
            lines += [_line(heading), _line(["---"] * len(heading)), *map(_line, rows), ""]
    return "\n".join(lines).rstrip("\n") + "\n"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


_STYLE = """body { font: 15px/1.5 sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em; color: #222; }
table { border-collapse: collapse; font-size: 13px; margin: 1em 0; }
th, td { border: 1px solid #ccc; padding: 2px 8px; text-align: left; vertical-align: top; overflow-wrap: anywhere; }
th { background: #eee; }"""


def html(content: Mapping[str, Any]) -> str:
    """The certificate as one self-contained HTML page."""
    title = markup.escape(f"Certificate of {content['robot']}")
    lines = [
        "<!DOCTYPE html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
        f"<style>\n{_STYLE}\n</style></head><body>",
    ]
    for kind, value in _blocks(content):
        if kind == "title":
            lines.append(f"<h1>{markup.escape(value)}</h1>")
        elif kind == "heading":
            lines.append(f"<h2>{markup.escape(value)}</h2>")
        elif kind == "text":
            lines.append(f"<p>{markup.escape(value)}</p>")
        elif kind == "list":
            lines += ["<ul>", *(f"<li>{markup.escape(item)}</li>" for item in value), "</ul>"]
        else:
            heading, *rows = value
            lines += ["<table>", _cells(heading, "th"), *(_cells(row, "td") for row in rows), "</table>"]
    return "\n".join([*lines, "</body></html>"]) + "\n"


def _cells(cells: Sequence[str], tag: str) -> str:
    return "<tr>" + "".join(f"<{tag}>{markup.escape(cell)}</{tag}>" for cell in cells) + "</tr>"
