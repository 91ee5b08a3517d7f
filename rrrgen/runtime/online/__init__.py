"""Online estimators in Python."""
