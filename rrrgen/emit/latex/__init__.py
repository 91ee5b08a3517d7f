"""Printing of closed forms as LaTeX and as plain text."""

from rrrgen.emit.latex.layout import Display, Equation, Form, lay_out, trig_abbreviates
from rrrgen.emit.latex.notation import GREEK, Notation, Quantity, notation, quantity
from rrrgen.emit.latex.output import (
    break_sum,
    latex,
    latex_base_parameters,
    latex_expression,
    plain,
    plain_expression,
)
from rrrgen.emit.latex.walk import Markup, Walk

__all__ = [
    "GREEK",
    "Display",
    "Equation",
    "Form",
    "Markup",
    "Notation",
    "Quantity",
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
