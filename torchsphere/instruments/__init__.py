"""Records of other instruments beside a track."""
