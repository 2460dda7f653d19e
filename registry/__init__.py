"""The fleet's cameras in git: entries with a digest over their numbers, the full history, and why an entry was chosen.

Five groups of modules, each building on the ones below it; none knows the command line.

* **The registry**: ``registry`` (its states and changes), ``snapshot`` (one state), ``proposals`` and ``writing``
  (checked changes as commits), ``history``, ``sync`` (pull and push), ``init``, ``configuration`` (``registry.yaml``).
* **Answers**: ``resolution`` with ``index`` and ``entry_match`` (which entry is a camera's), ``locking`` (a
  run's lock file), and the sub-package ``checks`` (everything that a schema cannot express).
* **Entries**: ``entry``, ``entry_form`` and ``entry_yaml`` (its file), ``fields`` (as a table, for people
  and for git diff), ``firmware``, ``paths``.
* **Others**: the sub-package ``published`` (a registry as static files, and their reader), ``contribution`` (an entry
  for a public registry, without what is private).
* **git**: the sub-package ``git``, which knows no camera.

The YAML files of ``catalogue`` are not the fleet's: they describe cameras in general, and
:mod:`calibrary.catalogue` reads them.
"""
