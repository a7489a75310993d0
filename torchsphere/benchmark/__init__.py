"""A benchmark for ball trackers: recordings with exact truth, made by `render`, and what a tracker scores on them."""
