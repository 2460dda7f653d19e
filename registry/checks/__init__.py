"""Everything about a registry that a schema cannot say.

``rules`` is what one entry is checked for, ``entries`` holds entries against one another. ``whole`` checks a registry,
``changes`` what differs between two revisions, ``approval`` who approved and signed it. ``files`` reads the entries
for them, and ``findings`` is what they return.
"""
