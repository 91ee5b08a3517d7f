"""The functions that rrrgen emits: for each a recorder, which derives it as a program, and the table of all of them."""
