"""Recordings as people have them: described by a mapping, read, repaired, and streamed in SI at the joints."""
