"""Export of robots to the formats of other programs; each module in ``targets/`` implements one format."""
