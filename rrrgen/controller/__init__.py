"""The controller of a robot as one unit in C: structs of parameters, state, input and output, and one call a period."""
