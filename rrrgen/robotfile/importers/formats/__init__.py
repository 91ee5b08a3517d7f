"""The formats that can be imported: every module here has an ``IMPORTER``."""
