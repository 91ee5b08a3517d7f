"""The example notebook runs from its first cell to its last, and shows pictures and equations."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")

NOTEBOOK = Path(__file__).resolve().parents[2] / "examples/notebook/first_steps.ipynb"


def test_every_cell_runs() -> None:
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "the notebook is kept without outputs"
    NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(NOTEBOOK.parent)}}).execute()
    shown = [set(output["data"]) for cell in notebook.cells for output in cell.get("outputs", ()) if "data" in output]
    assert sum("image/png" in kinds for kinds in shown) == 2
    assert sum("text/latex" in kinds for kinds in shown) == 2
    assert sum("text/html" in kinds for kinds in shown) == 2


def test_links_lead_to_files() -> None:
    links = re.findall(r"\]\(([^)#]+)\)", NOTEBOOK.read_text(encoding="utf-8"))
    assert links
    assert [link for link in links if "://" not in link and not (NOTEBOOK.parent / link).exists()] == []
