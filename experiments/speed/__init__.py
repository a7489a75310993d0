"""Time and memory of a measurement, beside other methods."""
