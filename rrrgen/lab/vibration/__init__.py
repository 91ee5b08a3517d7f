"""Input shapers and notch filters for the controller, designed from the measured resonances of a robot."""
