"""The measurements: calls in C, calls from Python, batches, inverse kinematics, growth with joints, generation."""
