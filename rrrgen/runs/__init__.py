"""Run folders: inputs, settings, seed, results and figures of one run, and the state from which it is resumed."""
