"""Audit of a fleet: comparison of the cameras of recent flights with the registry."""
