"""What a record becomes: C, floats, CasADi Functions."""
