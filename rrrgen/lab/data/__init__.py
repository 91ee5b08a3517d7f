"""Measured recordings in many file formats: read as a mapping file states, repaired, converted to SI at the joints."""
