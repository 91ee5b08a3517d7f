"""The emitted C of time-optimal path timing: a numerical kernel adapted to one robot."""
