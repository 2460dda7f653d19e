"""Checks of a registry beyond its schema.

``rules`` checks one entry, ``entries`` compares entries with each other. ``whole`` checks a registry, ``changes`` the
difference between two revisions, ``approval`` approvals and signatures. ``files`` reads the entries for the checks,
and ``findings`` contains the results.
"""
