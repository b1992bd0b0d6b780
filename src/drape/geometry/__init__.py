"""Meshes and their shape: edges, faces, hinges, patches, and what is nearest to what."""
