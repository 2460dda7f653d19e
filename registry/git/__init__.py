"""A git repository that files are read from and written to without losing a change; it knows no camera.

``program`` is the only module that starts git. ``repository`` builds on it, on ``objects`` and ``trees`` (read by the
bytes), ``discovery`` (where it is), ``names`` (what may reach git), ``foreign`` (what the configuration of a foreign
repository may not do) and ``damage`` (what is wrong with one that does not open). Above it: ``branches``, ``history``
and ``signatures`` (what was committed), ``writing`` with ``commits``, ``locks``, ``worktree`` and ``errors`` (what is
written), ``remotes`` with ``replay`` (other copies) and ``maintenance``. Nothing here imports anything else of
:mod:`calibrary.registry`.
"""
