"""Excitation of a joint for its frequency response, (14.36): signals, speed, and the runs of an experiment."""
