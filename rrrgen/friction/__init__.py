"""Friction of joints and drives: its laws, their programs, and models with numbers."""
