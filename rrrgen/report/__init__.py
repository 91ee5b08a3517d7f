"""One HTML file about a robot: its table, frames, parameters and equations, and how well they were verified."""

from rrrgen.report.document import html_report

__all__ = ["html_report"]
