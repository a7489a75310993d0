"""The errors of a track: a file per source, which detects it, widens the uncertainty, and says what it means."""
