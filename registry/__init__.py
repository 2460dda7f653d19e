"""calibrary.registry."""
