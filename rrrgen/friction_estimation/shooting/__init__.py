"""Output-error fit of one joint over many short windows of a recording: simulation, fit, standard deviations."""
