"""A registry as static files for any web server, and a reader of these files over HTTP.

``manifest`` defines the files and what is trusted, ``write`` writes those of a commit, ``fetch`` and ``cache`` provide
a single file, ``read`` finds the entries of a camera. docs/publishing.md describes the format for other readers.
"""
