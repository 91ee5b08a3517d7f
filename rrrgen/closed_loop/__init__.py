"""Identification by closed-loop output error: simulates controller and robot together and fits the torques."""
