"""What a figure was measured on: which data are fitted, what the filters let through, errors on named rows."""
