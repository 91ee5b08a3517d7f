"""What every room stands on: errors, located YAML, the writer of files, caches, parallel map."""
