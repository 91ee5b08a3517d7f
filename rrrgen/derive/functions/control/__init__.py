"""Functions for controllers: terms, control laws of joints and tip, momentum observer, contact, motions."""
