"""Readers of recorded tables, one format a file, behind one interface."""
