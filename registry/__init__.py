"""The registry: the fleet's cameras in git, with a digest of each entry's numbers and the full history.

Groups of modules, each based on the ones below it; none depends on the command line.

* **The registry**: ``registry`` (its states and changes), ``snapshot`` (one state), ``proposals``, ``editing`` and
  ``writing`` (checked changes as commits), ``approvals``, ``history``, ``sync`` (pull and push), ``init``,
  ``configuration`` (``registry.yaml``).
* **Queries**: ``resolution`` with ``index`` (the entry for a camera), ``query`` (selection by fields), ``locking``
  (the lock file of a run).
* **Checks**: everything that a schema cannot express: ``entry_checks`` (entries given as bytes), ``checks`` (a
  registry, or the difference between two revisions).
* **Entries**: ``entry`` and ``entry_yaml`` (the file of an entry), ``fields`` (as a table, for people and for git
  diff), ``firmware``, ``paths``.
* **Exchange**: the sub-package ``published`` (a registry as static files, and their reader), ``spreadsheet``.
* **git**: the sub-package ``git``, which knows nothing about cameras.

The YAML files of ``catalogue`` are not part of a fleet's registry: they describe camera models, and
:mod:`calibrary.catalogue` reads them.
"""
