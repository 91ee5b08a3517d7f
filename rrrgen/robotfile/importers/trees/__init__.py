"""Trees of rigid bodies, as URDF and MJCF describe them, to one serial chain with Denavit-Hartenberg rows."""
