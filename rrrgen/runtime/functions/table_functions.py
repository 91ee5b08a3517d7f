"""The methods of a model that are made from the table of model functions; the stub beside this file shows them."""

from __future__ import annotations

from rrrgen.runtime.functions.calls import Calls
from rrrgen.runtime.functions.methods import add_methods


class TableFunctions(Calls):
    """Methods for the functions of the model."""


add_methods(TableFunctions)
