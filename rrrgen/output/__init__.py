"""What is written: the only writer of files, and the manifest that lists them."""
