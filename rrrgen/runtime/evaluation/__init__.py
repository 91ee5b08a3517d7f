"""The recorded solver evaluated in Python's floats: the reference of the emitted C, for machines without a compiler."""
