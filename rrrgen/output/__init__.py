"""Output: the only writer of files, and the manifest that lists them."""
