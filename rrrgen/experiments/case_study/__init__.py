"""The case study of the chapter on the virtual RRR, from excitation to the writing task."""
