"""The fleet's cameras in git: entries with their K sealed, a store that loses nothing, answers with a reason.

Three groups of modules, each over the one below it; none knows of a command line, and only the store knows git.

* **Entries**: ``entry`` (what one says), ``entry_yaml`` (its file: the one writer, the one reader), ``digest``,
  ``migrations``, ``slug`` and ``firmware``; ``check`` (all that a schema cannot say), ``resolution`` and ``fitting``
  (which entry answers for a camera), ``pins`` (a run's lock file), ``folder`` (a registry without git), ``charter``.
* **A registry's life**: ``fleet`` (states and changes), ``writing`` with ``commits`` and ``conflicts``, ``history`` and
  ``revisions``, ``remotes`` with ``replay`` and ``urls``, ``signatures``, ``maintenance``, ``worktree``.
* **git**: ``store`` (the one door), ``objects``, ``fast_import``, ``locks``, ``layout`` (which paths), ``foreign``
  (what the configuration of a foreign repository may not do), ``creating``, ``messages``, ``explained``.

Beside them ``catalogue``, which is not the fleet's: what is known of cameras in general.
"""
