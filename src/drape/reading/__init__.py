"""Meshes and motions from the files that people have, with a record of what was seen and changed."""
