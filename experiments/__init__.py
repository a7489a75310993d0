"""Measurements behind the statements of the pages, one file each; run as ``python -m experiments.FOLDER.NAME``."""
