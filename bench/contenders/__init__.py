"""The contenders: rrrgen's emitted C, and rivals that do not use rrrgen's derivation."""
