"""Located YAML: nodes that know their place, values with units, every fault at once; used by every file format."""
