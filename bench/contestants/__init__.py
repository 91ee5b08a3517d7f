"""What rrrgen is measured against; nothing here uses rrrgen's derivation."""
