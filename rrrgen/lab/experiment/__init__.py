"""Experiments on the virtual robot: the experiment file, the writing task, the case study."""
