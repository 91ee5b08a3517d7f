"""The formats that can be imported, one module each; the importer is the module's constant ``IMPORTER``."""
