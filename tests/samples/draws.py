"""How many random cases a test draws: few in an ordinary run, ten times as many in ``make sweep``."""

import os


def draws(few: int) -> int:
    """``few`` in an ordinary run; ``RRRGEN_DRAWS`` multiplies it."""
    return few * int(os.environ.get("RRRGEN_DRAWS", "1"))
