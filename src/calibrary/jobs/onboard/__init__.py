"""A new payload taken on board: a folder of whatever came with it in, a proposed entry and its reasons out."""
