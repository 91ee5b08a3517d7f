"""The kernel that times a path, printed for one robot."""
