"""What follows from a resonance: input shapers and notch filters for the controller."""
