"""Run folders: settings, seeds, results and figures of one run, and resuming it."""
