"""A git repository that files are read from and written to, so that nothing is lost; it knows no camera.

``repository`` is the one module that starts git. Over it: ``objects`` and ``history`` (what was), ``writing`` with
``commits``, ``fast_import``, ``conflicts``, ``locks`` and ``worktree`` (what shall be), ``remotes`` with ``replay``
and ``urls`` (other copies), ``revisions``, ``signatures``, ``maintenance``; ``foreign`` says what the configuration
of a foreign repository may not do. Nothing here imports anything else of :mod:`calibrary.registry`.
"""
