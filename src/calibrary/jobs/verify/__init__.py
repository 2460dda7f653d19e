"""Whether the pixels of a few images agree with the K that a flight is about to use."""
