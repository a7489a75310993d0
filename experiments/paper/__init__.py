"""Figures and tables of the paper, on rendered shots whose motion is known; `all` joins their rows into RESULTS.md."""
