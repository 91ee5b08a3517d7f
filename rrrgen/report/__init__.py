"""The HTML report of a robot: its table, frames, parameters and equations, and the results of verification."""

from rrrgen.report.document import html_report

__all__ = ["html_report"]
