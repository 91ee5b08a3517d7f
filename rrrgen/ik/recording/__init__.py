"""Recording of a closed form: the builder interface of derivations, the recorded steps, their replay and their text."""
