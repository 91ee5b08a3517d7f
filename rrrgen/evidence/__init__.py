"""Evidence about emitted code: proven rounding bounds, findings of external tools, and the certificate of both."""
