"""Printing of closed forms as LaTeX and as plain text."""

from rrrgen.emit.latex.equations import (
    Display,
    Form,
    PrintedEquation,
    break_sum,
    latex,
    latex_base_parameters,
    latex_expression,
    lay_out,
    plain,
    plain_expression,
    trig_abbreviates,
)
from rrrgen.emit.latex.formulas import GREEK, Markup, Notation, QuantityNotation, Walk, notation, quantity

__all__ = [
    "GREEK",
    "Display",
    "Form",
    "Markup",
    "Notation",
    "PrintedEquation",
    "QuantityNotation",
    "Walk",
    "break_sum",
    "latex",
    "latex_base_parameters",
    "latex_expression",
    "lay_out",
    "notation",
    "plain",
    "plain_expression",
    "quantity",
    "trig_abbreviates",
]
