"""Functions for controllers: control laws of joints and tip, momentum observer, contact detection, desired motions."""
