"""The entry point of ``python -m rrrgen``, which is the same as the command ``rrrgen``."""

from rrrgen.cli import main

if __name__ == "__main__":
    main(prog_name="python -m rrrgen")
