"""From a recording to a track."""
