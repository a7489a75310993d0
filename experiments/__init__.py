"""Measurements behind the statements of the README, one file each; run as ``python -m experiments.NAME``."""
