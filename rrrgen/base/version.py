"""The version of rrrgen, for the package, its files and its digests."""

VERSION = "0.2.0"
