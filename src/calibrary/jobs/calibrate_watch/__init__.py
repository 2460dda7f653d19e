"""Watching a folder in which frames of a board arrive, and saying after each what is still missing."""
