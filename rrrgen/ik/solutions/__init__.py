"""The families of solutions, one a file, and the equations that they share."""
