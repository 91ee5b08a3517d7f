"""rrrgen side by side with what a user would pick instead: same states, same compiler, same flags, one run."""
