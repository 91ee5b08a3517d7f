"""The studies of the laboratory as functions of a robot, recordings and options; the commands are lines on them."""
