"""What runs on the controller: motions and filters as programs with their numbers folded in."""
