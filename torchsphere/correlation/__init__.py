"""From pairs of images to increments with their covariance."""
