"""Sentences that warn the user."""
