"""What waits in a registry, and for whom."""
