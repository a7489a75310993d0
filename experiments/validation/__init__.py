"""Errors and bands of torchsphere against a known truth, and the comparison with other trackers."""
