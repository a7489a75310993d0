"""The forward model: a map of the ball's texture, its adjustment, and the registration of frames on it."""
