"""Excitation of a joint to measure its frequency response: signals, speed, and the runs of an experiment.

Source: (14.36) of Kostic, de Jager, Steinbuch, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
"""
