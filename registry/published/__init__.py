"""A registry as static files for any web server, and a reader of these files over HTTP.

``layout`` defines the files and their content, ``write`` writes the files of a commit, ``fetch`` and ``cache`` provide
a single file with a verified digest, ``read`` finds the entries of a camera. docs/publishing.md describes the format
for readers in other languages.
"""
