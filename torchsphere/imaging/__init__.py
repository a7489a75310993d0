"""Interpolation, crops, still background and interlacing of images."""
