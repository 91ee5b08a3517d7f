"""Located YAML: nodes with line and column, values with units, all faults of a file reported together.

Every file format of rrrgen (robot, mapping, experiment, response files) is read through this package.
"""
