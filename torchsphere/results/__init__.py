"""Result folders: written after a measurement, read to draw reports."""
