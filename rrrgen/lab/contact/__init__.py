"""Contact detection: thresholds for the residuals of the momentum observer, from recordings without contact."""
