"""The fleet's cameras in git: entries with their K sealed, a history that loses nothing, answers with a reason.

Three groups of modules, each over the one below it; none knows of a command line.

* **Entries**: ``entry`` (what one says), ``entry_yaml`` (its file: the one writer, the one reader), ``digest``,
  ``migrations``, ``slug`` and ``firmware``; ``check`` (all that a schema cannot say), ``resolution`` and ``fitting``
  (which entry answers for a camera), ``pins`` (a run's lock file), ``folder`` (a registry without git), ``charter``.
* **A registry's life**: ``fleet`` (states and changes), ``layout`` (which paths).
* **git**: the sub-package ``git``, which knows no camera.

Beside them ``catalogue``, which is not the fleet's: what is known of cameras in general.
"""
