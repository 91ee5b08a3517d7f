"""One derivation, many interpreters: floats, C and CasADi behind one builder."""
