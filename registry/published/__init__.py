"""A registry as static files that any web server gives out, and the reader of such files over HTTP.

``layout`` says which file is where and what it contains, ``write`` writes the files of a commit, ``fetch`` and
``cache`` bring one file with its digest checked, ``read`` finds the entries of a camera. docs/publishing.md is the
same for readers in other languages.
"""
