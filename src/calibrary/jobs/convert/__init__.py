"""Converting many files: what came of each."""
