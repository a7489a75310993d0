"""Settings: valid values, and refusals of invalid values."""
