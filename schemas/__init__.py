"""calibrary.schemas."""
