"""Sphinx configuration of the documentation: ``make docs`` builds it into docs/_build/html."""

from rrrgen.base.version import VERSION

project = "rrrgen"
author = "the rrrgen authors"
project_copyright = author
release = version = VERSION

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_click", "sphinx_copybutton"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
copybutton_prompt_text = "$ "  # not part of what is copied
exclude_patterns = ["_build"]
nitpicky = False
suppress_warnings = ["myst.xref_missing", "ref.python"]  # links to folders of the repository; roles of private classes

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # shapes and units are in the text; the signatures of arrays say less
autodoc_class_signature = "separated"
napoleon_google_docstring = True

smartquotes = False  # options such as --json stay as they are typed

html_theme = "furo"
html_title = f"rrrgen {VERSION}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]


def escape_marks(app: object, context: object, lines: list[str]) -> None:
    """Keep what help texts print literally from being read as markup: ``*.yaml``, `` `rrrgen verify` ``, file:line:col.

    Lines that a help text indents, such as its examples, become a literal block.
    """
    escaped: list[str] = []
    literal = False
    for line in lines:
        if line.startswith("|   "):
            escaped += [] if literal else ["", ".. code-block:: text", ""]
            literal = True
            escaped.append(line[2:])
        else:
            escaped += [""] if literal else []
            literal = False
            text = line.replace("*", r"\*").replace("`", "``")
            escaped.append(text.replace("file:line:col", "``file:line:col``"))
    lines[:] = escaped


def setup(app):
    """Register the above for the text of every command."""
    app.connect("sphinx-click-process-description", escape_marks)
    app.connect("sphinx-click-process-epilog", escape_marks)
