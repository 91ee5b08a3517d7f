"""Conversion of trees of rigid bodies, as in URDF and MJCF, to one serial chain of Denavit-Hartenberg rows."""
