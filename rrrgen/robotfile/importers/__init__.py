"""Robots from the files of other programs; one format is one file in ``formats/``."""
