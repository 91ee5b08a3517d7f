"""Independent oracles: they share no code with rrrgen and work from plain numbers."""
