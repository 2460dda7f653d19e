"""Website of a registry: a searchable list, a page for each camera with its history, and a page for each change."""
