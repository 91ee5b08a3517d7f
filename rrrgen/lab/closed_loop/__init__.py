"""Identification by closed-loop output error: fits simulated torques of controller and robot to recorded torques."""
