"""What is probably wrong with a recording or a robot file, with the evidence and what to write instead.

One rule per file; each states its threshold and the reason for it. A clean recording passes all of them in silence.
"""
