"""Contact detection: thresholds for the momentum observer from recordings without contact."""
