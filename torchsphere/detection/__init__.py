"""From an image to the ball's circle."""
