"""Whether the K that someone is about to use is right for the images of a flight."""
