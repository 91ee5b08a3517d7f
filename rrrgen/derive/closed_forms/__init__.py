"""Closed forms: programs with their intermediates expanded and their trigonometry collected."""
