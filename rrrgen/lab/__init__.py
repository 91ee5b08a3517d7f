"""The laboratory: recordings, the virtual robot, excitation, identification and every other study of a real arm."""
