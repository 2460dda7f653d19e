"""Pixel check: whether the pixels of a few images agree with the K that a flight will use."""
