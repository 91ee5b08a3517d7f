"""One derivation, recorded once: the protocol of interpreters, the record, its text and what it costs."""
