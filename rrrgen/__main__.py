"""``python -m rrrgen``."""

from rrrgen.cli import main

if __name__ == "__main__":
    main(prog_name="python -m rrrgen")
