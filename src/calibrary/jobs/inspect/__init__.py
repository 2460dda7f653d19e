"""Identifying files: what a run reports."""
