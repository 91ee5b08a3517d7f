"""The robot: its file, importers of other formats, bundled robots, friction laws, and the exact model from it."""
