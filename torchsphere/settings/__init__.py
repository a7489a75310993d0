"""What a setting may be, and how an invalid value is refused."""
