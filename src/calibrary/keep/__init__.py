"""Keeping a fleet's registry: where it lies, which entry is meant, and what is written into it with which reason."""
