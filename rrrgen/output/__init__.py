"""Writing of output: the only code of rrrgen that writes its files, and the manifest that lists them."""
