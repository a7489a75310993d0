"""Signals of other instruments, compared with a track."""
