"""A git repository that files are read from and written to without losing a change; it knows no camera.

``repository`` is the only module that starts git. It builds on ``objects``, ``names`` (what may reach git) and
``foreign`` (what the configuration of a foreign repository may not do). Above it: ``history`` and ``signatures`` (what
was committed), ``writing`` with ``commits``, ``locks``, ``worktree`` and ``errors`` (what is written), ``remotes``
(other copies) and ``maintenance``. Nothing here imports anything else of :mod:`calibrary.registry`.
"""
