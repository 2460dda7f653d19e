"""A git repository with safe reading and writing of files, without losing a change; it knows nothing about cameras.

``program`` is the only module that starts git. ``repository`` (finding, making and reading one) is based on it, on
``objects`` (objects and trees), ``names`` (allowed names), ``foreign`` (restrictions on the configuration of a foreign
repository) and ``damage`` (diagnosis of a repository that does not open). Above it: ``history`` (commits and their
signatures), ``writing`` with ``locks`` and ``errors`` (making commits), and ``remotes`` (other copies).
Nothing here imports anything else of :mod:`calibrary.registry`.
"""
