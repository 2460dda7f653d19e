"""From what images say to witnesses of K, and from witnesses to one K with its grade."""
