"""The registry: the fleet's cameras in git, with a digest of each entry's numbers and the full history.

Five groups of modules, each based on the ones below it; none depends on the command line.

* **The registry**: ``registry`` (its states and changes), ``snapshot`` (one state), ``proposals`` and ``writing``
  (checked changes as commits), ``history``, ``sync`` (pull and push), ``init``, ``configuration`` (``registry.yaml``).
* **Queries**: ``resolution`` with ``index`` and ``entry_match`` (the entry for a camera), ``locking`` (the lock file
  of a run), and the sub-package ``checks`` (everything that a schema cannot express).
* **Entries**: ``entry``, ``entry_form`` and ``entry_yaml`` (the file of an entry), ``fields`` (as a table, for people
  and for git diff), ``firmware``, ``paths``.
* **Exchange**: the sub-package ``published`` (a registry as static files, and their reader), ``contribution`` (an
  entry for a public registry, without private data).
* **git**: the sub-package ``git``, which knows nothing about cameras.

The YAML files of ``catalogue`` are not part of a fleet's registry: they describe camera models, and
:mod:`calibrary.catalogue` reads them.
"""
