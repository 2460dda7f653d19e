"""Onboarding of a new payload: from a folder of files that came with it to proposed registry entries with reasons."""
