"""Functions for controllers: terms of observers and adaptive laws, control laws, the momentum observer, motions."""
