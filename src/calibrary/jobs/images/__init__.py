"""Images where they lie: listed once, each observed by itself, and what they say merged in any order."""
