"""Tests of rrrgen.verify."""
