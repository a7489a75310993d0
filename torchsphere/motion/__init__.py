"""The measured motion of a ball: the track, what was found out beside it, and the ledger of its errors."""
