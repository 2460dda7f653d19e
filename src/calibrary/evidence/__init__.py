"""From what images say to estimates of K, and from estimates to one K with its grade."""
