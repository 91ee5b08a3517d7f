"""What is measured: calls in C, calls from Python, batches, inverse kinematics, growth, generation."""
