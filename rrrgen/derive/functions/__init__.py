"""The public model functions: how each is recorded as a program, and the table of them all."""
