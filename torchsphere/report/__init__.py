"""Figures, pages, video and ParaView series of a result."""
