"""What each command takes, without what it does: nothing here imports torch, so that ``--help`` waits for nothing."""
