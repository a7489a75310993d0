"""From poses to position, velocity and force with their uncertainty."""
