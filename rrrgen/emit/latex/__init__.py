"""Printing of closed forms as LaTeX and as plain text."""
