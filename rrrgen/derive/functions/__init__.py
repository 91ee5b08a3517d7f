"""The public model functions: one recorder per function, and the table of all of them."""
