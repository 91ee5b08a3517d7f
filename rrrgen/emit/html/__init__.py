"""The HTML report of a robot: its table, frames, parameters and equations, and the results of verification."""

from rrrgen.emit.html.document import html_report

__all__ = ["html_report"]
