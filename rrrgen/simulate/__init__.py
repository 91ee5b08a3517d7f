"""The virtual robot: a model's dynamics with friction, drives, encoders and flexible modes, under sampled control."""
