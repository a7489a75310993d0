"""Threads, signals and hashes of files: what every step may use."""
