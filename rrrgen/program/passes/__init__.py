"""Passes: each takes a program to one that computes the same with fewer operations."""
