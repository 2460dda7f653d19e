"""A registry as web pages: a list to search, a page a camera with its history, and every change compared."""
