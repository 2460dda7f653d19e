"""A git repository with safe reading and writing of files, without losing a change; it knows nothing about cameras.

``program`` is the only module that starts git. ``repository`` is based on it, on ``objects`` and ``trees`` (reading),
``discovery`` (finding a repository), ``names`` (allowed names), ``foreign`` (restrictions on the configuration of a
foreign repository) and ``damage`` (diagnosis of a repository that does not open). Above it: ``branches``, ``history``
and ``signatures`` (reading commits), ``writing`` with ``commits``, ``locks``, ``worktree`` and ``errors`` (making
commits), ``remotes`` with ``replay`` (other copies) and ``maintenance``. Nothing here imports anything else of
:mod:`calibrary.registry`.
"""
