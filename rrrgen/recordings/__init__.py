"""Measured recordings in foreign formats: described by a mapping, read, repaired, and delivered in SI at the joints."""
