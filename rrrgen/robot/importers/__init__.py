"""Import of robots from the files of other programs; each format is one module of the folder ``formats/``."""
