"""Commands of the identification workflow, from excite to controller."""
